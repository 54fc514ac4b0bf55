// Shows point clouds in 3D on canvases: of the dashboard, and pasted into the report. No imports.
//
// All viewers share one WebGL2 context, whose picture is copied to the 2D canvas of each, because browsers drop the
// oldest context when a page has about sixteen. Where there is no WebGL, the same splats are drawn by script.

const FOCAL = 1 / Math.tan(0.3); // a field of view of 0.6 radians, vertical
const KEYS = 'Drag or arrow keys turn, with shift they move; + and − zoom, so does the wheel after a click; 0 resets.';
const SPLAT_VERTEX = `#version 300 es
in vec3 position; in vec3 colour;
uniform mat3 turn; uniform vec3 shift; uniform vec2 focal; uniform vec3 splat;
out vec3 tint; out float z; out float bulge;
void main() {
  vec3 p = turn * position + shift;
  gl_Position = vec4(p.x * focal.x, -p.y * focal.y, 0.0, p.z);
  gl_PointSize = max(splat.x * splat.y / p.z, splat.z);
  tint = colour; z = p.z; bulge = splat.x * 0.5;
}`;
const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec3 tint; in float z; in float bulge;
uniform vec2 range;
out vec4 colour;
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
uniform sampler2D colours; uniform highp sampler2D depths; uniform ivec2 size; uniform float reach;
out vec4 shaded;
ivec2 inside(ivec2 at) { return clamp(at, ivec2(0), size - 1); }
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depths, at, 0).r;
  if (depth >= 1.0) { // the background, but for a soft edge
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 9; i++) sum += texelFetch(colours, inside(at + ivec2(i % 3 - 1, i / 3 - 1)), 0);
    shaded = sum.a > 2.5 ? sum / 9.0 : vec4(0.0);
    return;
  }
  float behind = 0.0;
  for (int i = 0; i < 16; i++) {
    vec2 away = vec2(cos(float(i) * 0.7854), sin(float(i) * 0.7854)) * (i < 8 ? reach : reach * 3.0);
    behind += clamp(depth - texelFetch(depths, inside(at + ivec2(round(away))), 0).r, 0.0, 0.12);
  }
  shaded = vec4(texelFetch(colours, at, 0).rgb * exp(-1.6 * behind), 1.0);
}`;

const viewers = new Set();
let shared; // the renderer, made when the first viewer draws; null where there is no WebGL2

function createRenderer() {
  const canvas = document.createElement('canvas');
  const gl = canvas.getContext('webgl2', { antialias: false, depth: false });
  if (!gl) return null;
  const self = { ready: false, draw, forget };
  let programs, target;
  start();
  canvas.addEventListener('webglcontextlost', (event) => {
    event.preventDefault(); // else it is never restored
    self.ready = false;
    viewers.forEach((viewer) => viewer.draw());
  });
  canvas.addEventListener('webglcontextrestored', () => {
    viewers.forEach((viewer) => viewer.lose());
    start();
    viewers.forEach((viewer) => viewer.draw());
  });
  return self;

  function start() {
    programs = [program(SPLAT_VERTEX, SPLAT_FRAGMENT), program(SCREEN_VERTEX, SCREEN_FRAGMENT)];
    target = null;
    self.ready = programs.every((made) => gl.getProgramParameter(made, gl.LINK_STATUS));
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
    if (target && canvas.width >= width && canvas.height >= height) return;
    canvas.width = Math.max(canvas.width, width);
    canvas.height = Math.max(canvas.height, height);
    if (target) target.textures.forEach((texture) => gl.deleteTexture(texture));
    const framebuffer = target ? target.framebuffer : gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    const kinds = [[gl.RGBA8, gl.COLOR_ATTACHMENT0], [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]];
    const textures = kinds.map(([format, attachment]) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, canvas.width, canvas.height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, texture, 0);
      return texture;
    });
    target = { framebuffer, textures };
  }

  function upload(cloud) {
    const vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    const buffers = [cloud.centred, cloud.colours].map((data, i) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, 3, i ? gl.UNSIGNED_BYTE : gl.FLOAT, i === 1, 0, 0);
      return buffer;
    });
    return { vertices, buffers };
  }

  function forget(cloud) {
    if (!cloud || !cloud.uploaded) return;
    gl.deleteVertexArray(cloud.uploaded.vertices);
    cloud.uploaded.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    cloud.uploaded = null;
  }

  /** Draws the cloud and copies it into `context`; false if the WebGL context is lost. */
  function draw(cloud, scene, context) {
    const { width, height } = scene;
    makeRoom(width, height);
    cloud.uploaded ||= upload(cloud);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
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
    gl.bindVertexArray(cloud.uploaded.vertices);
    gl.drawArrays(gl.POINTS, 0, cloud.count);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(programs[1]);
    at = (name) => gl.getUniformLocation(programs[1], name);
    ['colours', 'depths'].forEach((name, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, target.textures[i]);
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

/** The same splats without WebGL, with a depth buffer in script. Farther is darker, so is the rim of a splat. */
function drawByScript(cloud, scene, context) {
  const { width, height, shift } = scene;
  const picture = context.createImageData(width, height);
  const pixels = picture.data;
  const depths = new Float32Array(width * height).fill(Infinity);
  for (let i = 0; i < cloud.count; i++) {
    const [cx, cy, z] = project(scene, cloud.centred.subarray(3 * i, 3 * i + 3));
    if (z < scene.near) continue;
    const radius = Math.max((scene.splat * scene.focal) / z, scene.smallest) / 2;
    const dim = 1.05 - 0.3 * ((z - shift[2]) / cloud.radius / 2 + 0.5);
    for (let v = Math.max(0, Math.ceil(cy - radius)); v <= Math.min(height - 1, cy + radius); v++) {
      for (let u = Math.max(0, Math.ceil(cx - radius)); u <= Math.min(width - 1, cx + radius); u++) {
        const up = 1 - ((u - cx) ** 2 + (v - cy) ** 2) / (radius * radius);
        const at = v * width + u;
        const depth = z - (scene.splat / 2) * up;
        if (up < 0 || depth >= depths[at]) continue;
        depths[at] = depth;
        for (let k = 0; k < 3; k++) pixels[4 * at + k] = cloud.colours[3 * i + k] * (0.8 + 0.2 * up) * dim;
        pixels[4 * at + 3] = 255;
      }
    }
  }
  context.putImageData(picture, 0, 0);
}

/** Pixel and depth of a point about the middle of its cloud. */
function project({ turn, shift, width, height, focal }, [x, y, z]) {
  const [right, down, depth] = [0, 3, 6].map((i) => turn[i] * x + turn[i + 1] * y + turn[i + 2] * z + shift[i / 3]);
  return [width / 2 + (right / depth) * focal, height / 2 + (down / depth) * focal, depth];
}

/** A cloud with its points about the middle of their box, its radius, and the median spacing of points. */
function prepare({ positions, colours, total }) {
  const count = positions.length / 3;
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  positions.forEach((value, i) => {
    low[i % 3] = Math.min(low[i % 3], value);
    high[i % 3] = Math.max(high[i % 3], value);
  });
  const centre = low.map((value, i) => (count ? (value + high[i]) / 2 : 0));
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
  return { count, total: total || count, centre, centred: p, colours, radius, spacing, uploaded: null };
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
 * Makes `canvas` show a cloud, in the size that CSS gives it. `onPick({index, at_m})` is told which point was clicked.
 * Shapes: `{kind: 'sphere' | 'circle', at_m: [x, y, z], radius_cm, colour: 'red' or '--c1', dash: [4, 2], label}`.
 */
export function createViewer(canvas, { label = 'cloud', onPick = null } = {}) {
  const context = canvas.getContext('2d');
  const listeners = new Set();
  const stop = new AbortController();
  const pointers = new Map();
  let [cloud, shapes, frame, visible, moved] = [null, [], 0, false, 0];
  // Linked viewers hold the same state, so they have one camera, and one scale: the larger object looks larger.
  let state = { camera: home(0.1), untouched: true, members: new Set() };

  const self = {
    /** Shows another cloud, `{positions (m), colours, total}`, or none; shapes go. */
    setCloud(given, name = label) {
      if (shared) shared.forget(cloud);
      [cloud, shapes, label] = [given && prepare(given), [], name];
      describe();
      if (state.untouched) self.fit();
      self.draw();
    },
    setShapes(given) {
      shapes = given;
      self.draw();
    },
    get camera() {
      return { ...state.camera };
    },
    /** Calls back with the camera whenever it moves; returns what stops that. */
    onCamera(callback) {
      listeners.add(callback);
      return () => listeners.delete(callback);
    },
    setCamera(change) {
      const camera = { ...state.camera, ...change };
      camera.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, camera.pitch));
      camera.distance = Math.max(0.01, Math.min(100, camera.distance));
      Object.assign(state, { camera, untouched: false });
      state.members.forEach((member) => member.follow());
    },
    fit() {
      self.setCamera(home(Math.max(0.001, ...[...state.members].map((member) => member.radius()))));
      state.untouched = true;
    },
    draw() {
      if (visible && !frame) frame = requestAnimationFrame(paint);
    },
    dispose() {
      stop.abort();
      resizes.disconnect();
      sight.disconnect();
      cancelAnimationFrame(frame);
      if (shared) shared.forget(cloud);
      [state.members, viewers].forEach((set) => set.delete(self));
      [cloud, visible] = [null, false];
    },
    // What follows is for linked viewers and the renderer.
    paint,
    radius: () => (cloud ? cloud.radius : 0),
    state: () => state,
    lose: () => cloud && (cloud.uploaded = null),
    follow() {
      listeners.forEach((callback) => callback(self.camera));
      self.draw();
    },
    join(other) {
      state.members.delete(self);
      state = other;
      state.members.add(self);
    },
  };

  function home(radius) {
    const narrow = Math.min(1, canvas.clientWidth / canvas.clientHeight) || 1;
    return { yaw: 0, pitch: 0, distance: (0.95 * radius) / Math.sin(0.3) / narrow, panX: 0, panY: 0 };
  }

  function describe() {
    const points = cloud ? `${cloud.count} points${cloud.total > cloud.count ? ` of ${cloud.total}` : ''}` : 'no cloud';
    canvas.setAttribute('aria-label', `${label}, ${points}. ${KEYS}`);
  }

  function scene() {
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((length) => Math.round(length * ratio));
    const { yaw, pitch, distance, panX, panY } = state.camera;
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const turn = [cy, 0, sy, sp * sy, cp, -sp * cy, -cp * sy, sp, cp * cy];
    const depth = self.radius() * 1.05;
    const [near, far] = [Math.max(distance - depth, distance / 100), distance + depth];
    const splat = cloud ? cloud.spacing * 1.7 : 0;
    const pixels = { focal: (FOCAL * height) / 2, smallest: 1.5 * ratio, reach: 1.3 * ratio };
    return { ratio, width, height, turn, shift: [panX, panY, distance], near, far, splat, ...pixels };
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
    shapes.forEach((shape) => drawShape(shape, now));
  }

  function drawShape({ kind, at_m, radius_cm, colour = 'currentcolor', dash = [], label: text }, now) {
    const middle = at_m.map((value, i) => value - cloud.centre[i]);
    const depth = project(now, middle)[2];
    const style = getComputedStyle(canvas);
    context.strokeStyle = context.fillStyle = colour.startsWith('--') ? style.getPropertyValue(colour) : colour;
    context.lineWidth = 1.75 * now.ratio;
    context.setLineDash(dash.map((length) => length * now.ratio));
    const ring = (a, b) => Array.from({ length: 65 }, (_, i) => {
      const [c, s] = [Math.cos((i * Math.PI) / 32), Math.sin((i * Math.PI) / 32)].map((part) => (part * radius_cm) / 100);
      return project(now, middle.map((value, k) => value + c * a[k] + s * b[k]));
    });
    const stroke = (points, opacity, shown) => {
      context.globalAlpha = opacity;
      context.beginPath();
      points.forEach((end, i) => i && shown(end) && (context.moveTo(...points[i - 1]), context.lineTo(...end)));
      context.stroke();
    };
    const outline = ring(now.turn.slice(0, 3), now.turn.slice(3, 6));
    const [x, y, z] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for (const points of kind === 'sphere' ? [ring(x, y), ring(x, z), ring(y, z)] : []) {
      stroke(points, 0.25, (end) => end[2] > depth);
      stroke(points, 0.6, (end) => end[2] <= depth);
    }
    stroke(outline, 1, () => true);
    if (!text) return;
    context.font = `${12 * now.ratio}px system-ui, sans-serif`;
    context.textAlign = 'center';
    const top = Math.min(...outline.map((point) => point[1])) - 5 * now.ratio;
    context.fillText(text, project(now, middle)[0], Math.max(12 * now.ratio, top));
  }

  function pick(event) {
    if (!cloud || !onPick) return;
    const now = scene();
    const box = canvas.getBoundingClientRect();
    let [best, least] = [-1, Infinity];
    for (let i = 0; i < cloud.count; i++) {
      const [x, y, z] = project(now, cloud.centred.subarray(3 * i, 3 * i + 3));
      const off = Math.hypot(x / now.ratio - event.clientX + box.left, y / now.ratio - event.clientY + box.top);
      // A point in front hides those behind: one pixel off counts as a fiftieth of the radius deeper.
      const cost = off < 14 ? off / 50 + z / cloud.radius : Infinity;
      if (cost < least) [best, least] = [i, cost];
    }
    if (best >= 0) onPick({ index: best, at_m: cloud.centre.map((value, k) => value + cloud.centred[3 * best + k]) });
  }

  const turnBy = (x, y) => self.setCamera({ yaw: state.camera.yaw - x, pitch: state.camera.pitch + y });
  const zoomBy = (factor) => self.setCamera({ distance: state.camera.distance * factor });
  function moveBy(x, y) {
    const metres = (2 * state.camera.distance) / FOCAL / Math.max(1, canvas.clientHeight);
    self.setCamera({ panX: state.camera.panX + x * metres, panY: state.camera.panY + y * metres });
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
    if (pointers.delete(event.pointerId) && moved < 4 && event.button === 0) pick(event);
  });
  listen('pointercancel', (event) => pointers.delete(event.pointerId));
  listen('contextmenu', (event) => event.preventDefault());
  listen('dblclick', self.fit);
  listen('wheel', (event) => {
    // Without focus it scrolls the page, lest a column of viewers catches it. Pinching comes as ctrl and wheel.
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    const pixels = Math.max(-200, Math.min(200, event.deltaY * (event.deltaMode === 1 ? 16 : 1)));
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

  const resizes = new ResizeObserver(() => (state.untouched ? self.fit() : self.draw()));
  resizes.observe(canvas);
  const sight = whenSeen(canvas, (seen) => {
    visible = seen;
    self.draw();
  });
  state.members.add(self);
  viewers.add(self);
  canvas.tabIndex = 0;
  canvas.setAttribute('role', 'application');
  canvas.setAttribute('aria-roledescription', '3D view');
  canvas.style.touchAction = 'pan-y'; // a finger still scrolls the page; sideways and two fingers are the viewer's
  describe();
  return self;
}

/** Gives several viewers one camera. */
export function link(several) {
  several.slice(1).forEach((viewer) => viewer.join(several[0].state()));
  if (several.length && several[0].state().untouched) several[0].fit();
}

/** Says by `callback(true)` when `element` nears the visible part of the page, and by `callback(false)` when it leaves. */
export function whenSeen(element, callback) {
  const tell = (entries) => callback(entries[entries.length - 1].isIntersecting);
  const observer = new IntersectionObserver(tell, { rootMargin: '300px' });
  observer.observe(element);
  return observer;
}

// What was never scrolled to is on paper too.
addEventListener('beforeprint', () => viewers.forEach((viewer) => viewer.paint()));
