// Shows point clouds in 3D on canvases: of the dashboard, and pasted into the report. No imports.
//
// All viewers share one WebGL2 context, whose picture is copied to the 2D canvas of each, because browsers drop the
// oldest context when a page has about sixteen. Where there is no WebGL, the same splats are drawn by script.

const FOCAL = 1 / Math.tan(0.3); // a field of view of 0.6 radians, vertical
const KEYS = 'Drag or arrow keys turn, with shift they move; + and − zoom, the wheel too after a click; 0 resets.';
const SPLAT_VERTEX = `#version 300 es
in vec3 position, colour;
uniform mat3 turn; uniform vec3 shift, splat; uniform vec2 focal;
out vec3 tint; out float z, bulge;
void main() {
  vec3 p = turn * position + shift;
  gl_Position = vec4(p.x * focal.x, -p.y * focal.y, 0.0, p.z);
  gl_PointSize = max(splat.x * splat.y / p.z, splat.z);
  tint = colour; z = p.z; bulge = splat.x * 0.5;
}`;
const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec3 tint; in float z, bulge; uniform vec2 range; out vec4 colour;
void main() {
  vec2 c = gl_PointCoord * 2.0 - 1.0;
  float up = 1.0 - dot(c, c);
  if (up < 0.0 || z < range.x) discard;
  up = sqrt(up);
  colour = vec4(tint * (0.85 + 0.15 * up), 1.0);
  gl_FragDepth = clamp((z - bulge * up - range.x) / (range.y - range.x), 0.0, 0.9999);
}`;
const SCREEN_VERTEX = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;
// Eye-dome lighting: a pixel is darkened by how far it lies behind its surroundings. Needs no normals.
const SCREEN_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler2D colours, depths; uniform ivec2 size; uniform float reach; out vec4 shaded;
ivec2 inside(ivec2 at) { return clamp(at, ivec2(0), size - 1); }
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depths, at, 0).r;
  if (depth >= 1.0) { // the background, but for a soft edge
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; i++) sum += texelFetch(colours, inside(at + ivec2(i / 2 * 2 - 1, i % 2 * 2 - 1)), 0);
    shaded = sum.a > 1.5 ? sum / 6.0 : vec4(0.0);
    return;
  }
  float behind = 0.0;
  for (int i = 0; i < 12; i++) {
    vec2 away = vec2(cos(float(i) * 1.0472), sin(float(i) * 1.0472)) * (i < 6 ? reach : reach * 3.0);
    behind += clamp(depth - texelFetch(depths, inside(at + ivec2(round(away))), 0).r, 0.0, 0.12);
  }
  shaded = vec4(texelFetch(colours, at, 0).rgb * exp(-2.1 * behind), 1.0);
}`;

const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
const viewers = new Set();
let shared; // the renderer, made when the first viewer draws; null where there is no WebGL2

function createRenderer() {
  const canvas = document.createElement('canvas');
  const gl = canvas.getContext('webgl2', { antialias: false, depth: false });
  if (!gl) return null;
  const self = { ready: false, draw, release: (cloud) => cloud.buffers.forEach((made) => gl.deleteBuffer(made)) };
  let programs, framebuffer, textures;
  start();
  canvas.addEventListener('webglcontextlost', (event) => {
    event.preventDefault(); // else it is never restored
    self.ready = false;
    viewers.forEach((viewer) => viewer.lost());
  });
  canvas.addEventListener('webglcontextrestored', start);
  return self;

  function start() {
    programs = [program(SPLAT_VERTEX, SPLAT_FRAGMENT), program(SCREEN_VERTEX, SCREEN_FRAGMENT)];
    framebuffer = gl.createFramebuffer();
    textures = [0, 1].map(() => gl.createTexture());
    canvas.width = canvas.height = 1;
    self.ready = programs.every((made) => gl.getProgramParameter(made, gl.LINK_STATUS));
    viewers.forEach((viewer) => viewer.draw());
  }

  function program(...sources) {
    const made = gl.createProgram();
    sources.forEach((source, i) => {
      const shader = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    });
    ['position', 'colour'].forEach((name, i) => gl.bindAttribLocation(made, i, name));
    gl.linkProgram(made);
    return made;
  }

  // Canvas and textures only grow: viewers of several sizes take turns.
  function makeRoom(width, height) {
    if (canvas.width >= width && canvas.height >= height) return;
    [canvas.width, canvas.height] = [Math.max(canvas.width, width), Math.max(canvas.height, height)];
    const colour = [gl.COLOR_ATTACHMENT0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE];
    const depth = [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT];
    [colour, depth].forEach(([attachment, stored, ...given], i) => {
      gl.bindTexture(gl.TEXTURE_2D, textures[i]);
      gl.texImage2D(gl.TEXTURE_2D, 0, stored, canvas.width, canvas.height, 0, ...given, null);
      [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER].forEach((at) => gl.texParameteri(gl.TEXTURE_2D, at, gl.NEAREST));
      gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, textures[i], 0);
    });
  }

  function use(cloud) {
    [cloud.centred, cloud.colours].forEach((data, i) => {
      const known = cloud.buffers[i];
      gl.bindBuffer(gl.ARRAY_BUFFER, (cloud.buffers[i] = known || gl.createBuffer()));
      if (!known) gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, 3, i ? gl.UNSIGNED_BYTE : gl.FLOAT, i === 1, 0, 0);
    });
  }

  /** Draws the cloud and copies it into `context`; false if the WebGL context is lost. */
  function draw(cloud, scene, context) {
    const { width, height } = scene;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    makeRoom(width, height);
    use(cloud);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    let at = (name) => gl.getUniformLocation(programs[0], name);
    gl.useProgram(programs[0]);
    gl.uniformMatrix3fv(at('turn'), true, scene.turn);
    gl.uniform3f(at('shift'), ...scene.shift);
    gl.uniform2f(at('focal'), (FOCAL * height) / width, FOCAL);
    gl.uniform2f(at('range'), scene.near, scene.far);
    gl.uniform3f(at('splat'), scene.splat, scene.focal, scene.smallest);
    gl.drawArrays(gl.POINTS, 0, cloud.count);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(programs[1]);
    at = (name) => gl.getUniformLocation(programs[1], name);
    ['colours', 'depths'].forEach((name, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, textures[i]);
      gl.uniform1i(at(name), i);
    });
    gl.uniform2i(at('size'), width, height);
    gl.uniform1f(at('reach'), scene.reach);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    if (gl.isContextLost()) return false;
    context.drawImage(canvas, 0, canvas.height - height, width, height, 0, 0, width, height);
    return true;
  }
}

/** The same splats without WebGL, farthest first. Farther is darker. */
function drawByScript(cloud, scene, context) {
  const points = Array.from({ length: cloud.count }, (_, i) => [i, ...scene.project(cloud.centred, 3 * i)]);
  for (const [i, x, y, z] of points.sort((a, b) => b[3] - a[3])) {
    if (z < scene.near) continue;
    const light = 0.7 + (0.3 * (scene.far - z)) / (scene.far - scene.near);
    const tint = (dim) => `rgb(${[0, 1, 2].map((k) => Math.round(cloud.colours[3 * i + k] * dim)).join(' ')})`;
    const radius = Math.max((scene.splat * scene.focal) / z, scene.smallest) / 2;
    context.fillStyle = tint(light);
    context.strokeStyle = tint(light * 0.8);
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fill();
    if (radius > 2) context.stroke();
  }
}

/** A cloud with its points about the middle of their box, its radius, and the median spacing of points. */
function prepare({ positions, colours, total }) {
  const count = positions.length / 3;
  const centre = [0, 1, 2].map((k) => {
    const sorted = positions.filter((_, i) => i % 3 === k).sort();
    return count ? (sorted[0] + sorted[count - 1]) / 2 : 0;
  });
  const p = positions.map((value, i) => value - centre[i % 3]);
  const squared = (x, y, z) => x * x + y * y + z * z;
  let radius = 1e-6;
  for (let i = 0; i < p.length; i += 3) radius = Math.max(radius, squared(p[i], p[i + 1], p[i + 2]));
  radius = Math.sqrt(radius);
  const spacings = [];
  for (let i = 0; i < p.length; i += 3 * Math.ceil(count / 48)) {
    let nearest = Infinity;
    for (let j = 0; j < p.length; j += 3) {
      nearest = Math.min(nearest, squared(p[i] - p[j], p[i + 1] - p[j + 1], p[i + 2] - p[j + 2]) || Infinity);
    }
    if (nearest < Infinity) spacings.push(Math.sqrt(nearest));
  }
  const spacing = spacings.sort((a, b) => a - b)[spacings.length >> 1] || radius / 20;
  return { count, total: total || count, centre, centred: p, colours, radius, spacing, buffers: [] };
}

/** Reads the answer of `/api/cloud`: `{positions (m), colours, count, total}`. */
export function decodeCloud(buffer) {
  const [view, size] = [new DataView(buffer), buffer.byteLength];
  const count = size < 24 ? 0 : view.getUint32(0, true);
  if (size !== 24 + 9 * count) {
    throw new Error(`cloud: its length and its number of points differ, got ${size} bytes, ${count} points\nreload`);
  }
  const [x, y, z, unit] = [8, 12, 16, 20].map((at) => view.getFloat32(at, true));
  const positions = Float32Array.from({ length: 3 * count }, (_, i) => view.getInt16(24 + 2 * i, true) * unit);
  for (let i = 0; i < 3 * count; i++) positions[i] += [x, y, z][i % 3];
  return { positions, colours: new Uint8Array(buffer, 24 + 6 * count), count, total: view.getUint32(4, true) };
}

/**
 * Makes `canvas` show a cloud, in the size that CSS gives it. `overlay(context, scene, cloud)` may draw over it;
 * `onClick(event, scene, cloud)` is told of clicks that turn nothing.
 */
export function createViewer(canvas, { label = 'cloud', overlay = null, onClick = null } = {}) {
  const context = canvas.getContext('2d');
  const listeners = new Set();
  const stop = new AbortController();
  const pointers = new Map();
  let [cloud, frame, visible, moved] = [null, 0, false, 0];
  const self = {
    // Linked viewers hold the same state, so they have one camera, and one scale: the larger object looks larger.
    state: { camera: home(0.1), untouched: true, members: new Set() },
    /** Shows another cloud, `{positions (m), colours, total}`, or none. */
    setCloud(given, name = label) {
      if (cloud && shared) shared.release(cloud);
      [cloud, label] = [given && prepare(given), name];
      describe();
      if (self.state.untouched) self.fit();
      self.draw();
    },
    get camera() {
      return { ...self.state.camera };
    },
    /** Calls back with the camera whenever it moves; returns what stops that. */
    onCamera(callback) {
      listeners.add(callback);
      return () => listeners.delete(callback);
    },
    setCamera(change) {
      const camera = { ...self.state.camera, ...change };
      camera.pitch = clamp(camera.pitch, -Math.PI / 2, Math.PI / 2);
      camera.distance = clamp(camera.distance, 0.01, 100);
      Object.assign(self.state, { camera, untouched: false });
      self.state.members.forEach((member) => member.moved());
    },
    fit() {
      self.setCamera(home(Math.max(0.001, ...[...self.state.members].map((member) => member.radius()))));
      self.state.untouched = true;
    },
    draw() {
      if (visible && !frame) frame = requestAnimationFrame(paint);
    },
    dispose() {
      self.setCloud(null);
      stop.abort();
      [resizes, sight].forEach((observer) => observer.disconnect());
      cancelAnimationFrame(frame);
      [self.state.members, viewers].forEach((set) => set.delete(self));
      visible = false;
    },
    // What follows is for linked viewers and the renderer.
    paint,
    radius: () => (cloud ? cloud.radius : 0),
    lost() {
      if (cloud) cloud.buffers = [];
      self.draw();
    },
    moved() {
      listeners.forEach((callback) => callback(self.camera));
      self.draw();
    },
  };

  function home(radius) {
    const narrow = Math.min(1, canvas.clientWidth / canvas.clientHeight) || 1;
    return { yaw: 0, pitch: 0, distance: (0.95 * radius) / Math.sin(0.3) / narrow, panX: 0, panY: 0 };
  }

  function describe() {
    const points = cloud ? `${cloud.count} points${cloud.total > cloud.count ? ` of ${cloud.total}` : ''}` : 'no cloud';
    canvas.ariaLabel = `${label}, ${points}. ${KEYS}`;
  }

  function scene() {
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((length) => Math.round(length * ratio));
    const { yaw, pitch, distance, panX, panY } = self.state.camera;
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const turn = [cy, 0, sy, sp * sy, cp, -sp * cy, -cp * sy, sp, cp * cy];
    const [near, far] = [-1.05, 1.05].map((side) => Math.max(distance + side * self.radius(), distance / 100));
    const focal = (FOCAL * height) / 2; // in pixels
    // Pixel and depth of the point at `i` in a list of coordinates about the middle of the cloud.
    const project = (p, i = 0) => {
      const [x, y, z] = [0, 3, 6].map((k) => turn[k] * p[i] + turn[k + 1] * p[i + 1] + turn[k + 2] * p[i + 2]);
      const depth = z + distance;
      return [width / 2 + ((x + panX) / depth) * focal, height / 2 + ((y + panY) / depth) * focal, depth];
    };
    const sizes = { splat: cloud ? cloud.spacing * 1.7 : 0, smallest: 1.5 * ratio, reach: 1.3 * ratio };
    return { ratio, width, height, focal, turn, shift: [panX, panY, distance], near, far, project, ...sizes };
  }

  function paint() {
    frame = 0;
    const now = scene();
    if (!now.width || !now.height) return;
    [canvas.width, canvas.height] = [now.width, now.height]; // clears it too
    if (!cloud) return;
    if (shared === undefined) shared = createRenderer();
    const byGpu = shared && shared.ready && shared.draw(cloud, now, context);
    if (!byGpu) drawByScript(cloud, now, context);
    canvas.dataset.drawn = byGpu ? 'webgl' : 'script';
    if (overlay) overlay(context, now, cloud);
  }

  const turnBy = (x, y) => self.setCamera({ yaw: self.state.camera.yaw - x, pitch: self.state.camera.pitch + y });
  const zoomBy = (factor) => self.setCamera({ distance: self.state.camera.distance * factor });
  function moveBy(x, y) {
    const metres = (2 * self.state.camera.distance) / FOCAL / Math.max(1, canvas.clientHeight);
    self.setCamera({ panX: self.state.camera.panX + x * metres, panY: self.state.camera.panY + y * metres });
  }
  const listen = (name, handler) => canvas.addEventListener(name, handler, { signal: stop.signal, passive: false });
  listen('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved = pointers.size > 1 ? Infinity : 0;
  });
  listen('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const after = [event.clientX, event.clientY];
    const [x, y] = [after[0] - before[0], after[1] - before[1]];
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    moved += Math.abs(x) + Math.abs(y);
    if (moved < 4) return;
    pointers.set(event.pointerId, after);
    if (other) {
      const apart = (point) => Math.max(1, Math.hypot(point[0] - other[1][0], point[1] - other[1][1]));
      zoomBy(apart(before) / apart(after));
      moveBy(x / 2, y / 2);
    } else if (event.shiftKey || event.buttons & 6) moveBy(x, y);
    else turnBy(x * 0.01, y * 0.01);
  });
  listen('pointerup', (event) => {
    const clicked = pointers.delete(event.pointerId) && moved < 4 && event.button === 0;
    if (clicked && cloud && onClick) onClick(event, scene(), cloud);
  });
  listen('pointercancel', (event) => pointers.delete(event.pointerId));
  listen('contextmenu', (event) => event.preventDefault());
  listen('dblclick', self.fit);
  listen('wheel', (event) => {
    // Without focus it scrolls the page, lest a column of viewers catches it. Pinching comes as ctrl and wheel.
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    const pixels = clamp(event.deltaY * (event.deltaMode === 1 ? 16 : 1), -200, 200);
    zoomBy(Math.exp(pixels * (event.ctrlKey ? 0.01 : 0.0015)));
  });
  listen('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const zoom = { '+': 1 / 1.15, '=': 1 / 1.15, '-': 1.15, _: 1.15 }[event.key];
    if (arrow && event.shiftKey) moveBy(arrow[0] * 16, arrow[1] * 16);
    else if (arrow) turnBy(arrow[0] * 0.12, arrow[1] * 0.12);
    else if (zoom) zoomBy(zoom);
    else if (event.key === '0') self.fit();
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  const resizes = new ResizeObserver(() => (self.state.untouched ? self.fit() : self.draw()));
  resizes.observe(canvas);
  const sight = whenSeen(canvas, (seen) => {
    visible = seen;
    self.draw();
  });
  self.state.members.add(self);
  viewers.add(self);
  Object.assign(canvas, { tabIndex: 0, role: 'application', ariaRoleDescription: '3D view' });
  canvas.style.touchAction = 'pan-y'; // a finger still scrolls the page; sideways and two fingers are the viewer's
  describe();
  return self;
}

/** Gives several viewers one camera. */
export function link([first, ...others]) {
  others.forEach((viewer) => {
    viewer.state.members.delete(viewer);
    viewer.state = first.state;
    first.state.members.add(viewer);
  });
  if (first.state.untouched) first.fit();
}

/** Calls `callback(true)` when `element` nears the visible part of the page, `callback(false)` when it leaves. */
export function whenSeen(element, callback) {
  const observer = new IntersectionObserver((all) => callback(all.at(-1).isIntersecting), { rootMargin: '2000px' });
  observer.observe(element);
  return observer;
}

// What was never scrolled to is on paper too.
addEventListener('beforeprint', () => viewers.forEach((viewer) => viewer.paint()));
