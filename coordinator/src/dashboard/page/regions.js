// A viewer of a cloud in which points can be picked and regions drawn around them.
import { createViewer } from './viewer.js';

const POLYLINE = 64;
const AXES = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

/**
 * Makes a viewer that tells `onPick({index, at_m})` which point was clicked, and has `setShapes`:
 * `{kind: 'sphere' | 'circle', at_m: [x, y, z], radius_cm, colour: 'red' or '--c1', dash: [4, 2], label}`.
 */
export function createRegionViewer(canvas, { label, onPick }) {
  let shapes = [];
  const overlay = (context, scene, cloud) => shapes.forEach((shape) => drawShape(context, scene, cloud, shape));
  const onClick = (event, scene, cloud) => {
    const index = pointUnder(canvas, event, scene, cloud);
    if (index !== null) onPick({ index, at_m: cloud.centre.map((value, k) => value + cloud.centred[3 * index + k]) });
  };
  const viewer = createViewer(canvas, { label, overlay, onClick });
  viewer.setShapes = (given) => {
    shapes = given;
    viewer.draw();
  };
  return viewer;
}

function drawShape(context, scene, cloud, { kind, at_m, radius_cm, colour, dash = [], label }) {
  const middle = at_m.map((value, k) => value - cloud.centre[k]);
  const ring = (a, b) =>
    Array.from({ length: POLYLINE + 1 }, (_, i) => {
      const angle = (2 * Math.PI * i) / POLYLINE;
      const [c, s] = [Math.cos(angle), Math.sin(angle)].map((part) => (part * radius_cm) / 100);
      return scene.project(middle.map((value, k) => value + c * a[k] + s * b[k]));
    });
  const style = getComputedStyle(context.canvas);
  const ink = colour.startsWith('--') ? style.getPropertyValue(colour) : colour;
  const halo = style.getPropertyValue('--panel') || 'white';
  const size = parseFloat(style.fontSize) * scene.ratio;
  const draw = (points, width, dashes) => {
    context.lineWidth = (width * size) / 14;
    context.setLineDash(dashes.map((length) => (length * size) / 14));
    context.beginPath();
    points.forEach(([right, down]) => context.lineTo(right, down));
    context.stroke();
  };
  // The rows of the rotation are the axes of the screen: they give the outline.
  const outline = ring(scene.turn.slice(0, 3), scene.turn.slice(3, 6));
  const [x, y, z] = AXES;
  const great = kind === 'sphere' ? [ring(x, y), ring(x, z), ring(y, z)] : [];
  // A halo, because the cloud below may have the colour of the line.
  context.strokeStyle = halo;
  context.globalAlpha = 0.75;
  draw(outline, 4, []);
  context.strokeStyle = context.fillStyle = ink;
  for (const points of [...great, outline]) {
    context.globalAlpha = points === outline ? 1 : 0.4;
    draw(points, 1.75, dash);
  }
  if (!label) return;
  context.font = `600 ${0.9 * size}px system-ui, sans-serif`;
  context.textAlign = 'center';
  const at = [scene.project(middle)[0], Math.max(size, Math.min(...outline.map((point) => point[1])) - 0.4 * size)];
  context.setLineDash([]);
  context.lineWidth = 0.25 * size;
  context.lineJoin = 'round';
  context.strokeStyle = halo;
  context.strokeText(label, ...at);
  context.fillText(label, ...at);
}

function pointUnder(canvas, event, scene, cloud) {
  const box = canvas.getBoundingClientRect();
  let best = null;
  let least = Infinity;
  for (let i = 0; i < cloud.count; i++) {
    const [x, y, z] = scene.project(cloud.centred, 3 * i);
    const off = Math.hypot(x / scene.ratio - event.clientX + box.left, y / scene.ratio - event.clientY + box.top);
    // A point in front hides those behind: one pixel off counts as a fiftieth of the radius deeper.
    const cost = off < 14 ? off / 50 + z / cloud.radius : Infinity;
    if (cost < least) [best, least] = [i, cost];
  }
  return best;
}
