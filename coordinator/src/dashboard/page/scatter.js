// A scatter of two columns of the individuals on a canvas, over the landscape of the grid where that is known.

import { drawAxes, extent, linear } from './axes.js';
import { colour, h, onWidth, prepareCanvas, replace, svg } from './dom.js';
import { rampColours, rampIndex } from './ramp.js';

const MARGIN = { top: 26, right: 14, bottom: 42, left: 58 };
const REACH = 9;

const stepOf = (sorted) => {
  let least = Infinity;
  for (let index = 1; index < sorted.length; index++) least = Math.min(least, sorted[index] - sorted[index - 1]);
  return Number.isFinite(least) ? least : 1;
};

/** Distinct values of the landscape and the width of a cell along one gene. */
function cells(values) {
  const sorted = [...new Set(values)].sort((a, b) => a - b);
  return { low: sorted[0], high: sorted[sorted.length - 1], step: stepOf(sorted) };
}

/**
 * @param {HTMLElement} root
 * @param {{onbrush: function(object): void, onselect: function(number): void}} options `onbrush` takes
 *   {x: [low, high], y: [low, high]}
 */
export function createScatter(root, { onbrush, onselect }) {
  const height = 380;
  const canvas = h('canvas', { 'aria-hidden': 'true' });
  const overlay = svg('svg', { class: 'overlay', role: 'img', height });
  const stage = h('div', { class: 'stage', style: { height: `${height}px` } }, canvas, overlay);
  root.append(stage);
  let width = 0;
  let spec = null;
  let scales = null;

  function scalesOf() {
    const values = (name) => spec.rows.map((row) => spec.table[name][row]);
    const [xs, ys] = [values(spec.x), values(spec.y)];
    let [dx, dy] = [extent(xs), extent(ys)];
    if (spec.landscape) {
      const { a, b } = spec.landscape;
      dx = [Math.min(dx[0], a.low - a.step / 2), Math.max(dx[1], a.high + a.step / 2)];
      dy = [Math.min(dy[0], b.low - b.step / 2), Math.max(dy[1], b.high + b.step / 2)];
    }
    return { x: linear(dx, [MARGIN.left, width - MARGIN.right]), y: linear(dy, [height - MARGIN.bottom, MARGIN.top]) };
  }

  function drawLandscape(context, colours) {
    const { a, b, table, domain } = spec.landscape;
    const { x, y } = scales;
    const [w, tall] = [Math.abs(x(a.step) - x(0)) + 0.7, Math.abs(y(b.step) - y(0)) + 0.7];
    context.globalAlpha = 0.75;
    for (let row = 0; row < table.rows; row++) {
      context.fillStyle = colours[rampIndex(table.columns.best_object_error[row], domain)];
      context.fillRect(x(table.columns.value_a[row]) - w / 2, y(table.columns.value_b[row]) - tall / 2, w, tall);
    }
    context.globalAlpha = 1;
  }

  function dots(context, rows, radius, fill, stroke) {
    const { x, y } = scales;
    context.fillStyle = fill;
    context.strokeStyle = stroke ?? fill;
    context.beginPath();
    for (const row of rows) {
      const [vx, vy] = [spec.table[spec.x][row], spec.table[spec.y][row]];
      if (vx === null || vy === null || vx === undefined || vy === undefined) continue;
      const [px, py] = [x(vx), y(vy)];
      context.moveTo(px + radius, py);
      context.arc(px, py, radius, 0, 2 * Math.PI);
    }
    if (fill !== 'none') context.fill();
    if (stroke) context.stroke();
  }

  function draw() {
    if (width === 0 || spec === null) return;
    scales = scalesOf();
    const context = prepareCanvas(canvas, width, height);
    const colours = rampColours();
    if (spec.landscape) drawLandscape(context, colours);
    const buckets = colours.map(() => []);
    const others = [];
    for (const row of spec.rows) {
      if (!spec.passes(row)) others.push(row);
      else buckets[rampIndex(spec.table[spec.colourBy][row], spec.colourDomain)].push(row);
    }
    const radius = spec.rows.length > 5000 ? 2.2 : spec.rows.length > 800 ? 3 : 4.5;
    const outline = spec.landscape ? colour('--panel') : null;
    context.lineWidth = 1;
    context.globalAlpha = 0.35;
    dots(context, others, radius * 0.7, colour('--muted'));
    context.globalAlpha = outline ? 1 : 0.75;
    for (let index = colours.length - 1; index >= 0; index--)
      dots(context, buckets[index], radius, colours[index], outline);
    context.globalAlpha = 1;
    context.lineWidth = 1.5;
    dots(context, spec.front ?? [], radius + 3, 'none', colour('--text'));
    if (spec.selected !== null && spec.selected !== undefined) {
      context.lineWidth = 3;
      dots(context, [spec.selected], radius + 5, 'none', colour('--c2'));
    }
    overlay.setAttribute('viewBox', `0 0 ${width} ${height}`);
    overlay.setAttribute('width', width);
    overlay.setAttribute('aria-label', `${spec.label} Individuals are in the table.`);
    replace(
      overlay,
      drawAxes({ ...scales, xTitle: spec.xTitle, yTitle: spec.yTitle, xFormat: spec.xFormat, yFormat: spec.yFormat }),
    );
    const [rx, ry] = [spec.ranges.get(spec.x), spec.ranges.get(spec.y)];
    if (rx || ry) {
      const clamp = (scale, end, fallback) => (Number.isFinite(end) ? scale(end) : fallback);
      const [left, right] = rx
        ? [clamp(scales.x, rx[0], MARGIN.left), clamp(scales.x, rx[1], width - MARGIN.right)]
        : scales.x.range;
      const [low, high] = ry
        ? [clamp(scales.y, ry[0], scales.y.range[0]), clamp(scales.y, ry[1], scales.y.range[1])]
        : scales.y.range;
      overlay.append(
        svg('rect', {
          class: 'brush',
          x: left,
          width: Math.max(1, right - left),
          y: high,
          height: Math.max(1, low - high),
        }),
      );
    }
  }

  const place = (event) => {
    const box = overlay.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  let drag = null;
  overlay.addEventListener('pointerdown', (event) => {
    if (scales === null || event.button !== 0) return;
    drag = { from: place(event), rect: svg('rect', { class: 'brush' }) };
    if (event.pointerType !== 'touch') overlay.setPointerCapture(event.pointerId);
  });
  overlay.addEventListener('pointermove', (event) => {
    if (drag === null || event.pointerType === 'touch') return;
    const [x, y] = place(event);
    overlay.append(drag.rect);
    drag.rect.setAttribute('x', Math.min(x, drag.from[0]));
    drag.rect.setAttribute('width', Math.abs(x - drag.from[0]));
    drag.rect.setAttribute('y', Math.min(y, drag.from[1]));
    drag.rect.setAttribute('height', Math.abs(y - drag.from[1]));
  });
  overlay.addEventListener('pointerup', (event) => {
    if (drag === null) return;
    const { from, rect } = drag;
    drag = null;
    rect.remove();
    const [x, y] = place(event);
    if (Math.abs(x - from[0]) < 5 && Math.abs(y - from[1]) < 5) {
      pick(x, y);
      return;
    }
    if (event.pointerType === 'touch') return;
    const sorted = (a, b) => [a, b].sort((one, other) => one - other);
    onbrush({
      x: sorted(scales.x.invert(from[0]), scales.x.invert(x)),
      y: sorted(scales.y.invert(from[1]), scales.y.invert(y)),
    });
  });

  function pick(x, y) {
    let best = null;
    let distance = REACH;
    for (const row of spec.rows) {
      if (!spec.passes(row)) continue;
      const off = Math.hypot(scales.x(spec.table[spec.x][row]) - x, scales.y(spec.table[spec.y][row]) - y);
      if (off < distance) [best, distance] = [row, off];
    }
    if (best !== null) onselect(best);
  }

  const stop = onWidth(stage, (now) => {
    width = now;
    draw();
  });

  return {
    /** Draws {rows, table (columns), x, y, titles and formats, ranges, passes, colourBy, colourDomain, landscape?, front?, selected, label}. */
    draw(next) {
      spec = next;
      draw();
    },
    destroy() {
      stop();
    },
  };
}

/** A landscape as the scatter needs it: cells along both genes and the errors' ends. */
export function prepareLandscape({ table }) {
  const domain = extent(table.columns.best_object_error, { margin: 0 });
  return { table, domain, a: cells(table.columns.value_a), b: cells(table.columns.value_b) };
}
