// Parallel coordinates on a canvas: a line for each individual, an axis for each column, brushed along the axes.

import { extent, linear, ticks } from './axes.js';
import { colour, h, onWidth, prepareCanvas, replace, svg } from './dom.js';
import { rampColours, rampIndex } from './ramp.js';

const HEIGHT = 300;
const TOP = 34;
const BOTTOM = 26;
const LEAST_STEP = 76;
const SIDE = 58;
const REACH = 6;
const LINES_A_PATH = 150;

/**
 * @param {HTMLElement} root
 * @param {{onbrush: function(string, [number, number]|null): void, onselect: function(number): void}} options
 */
export function createParallel(root, { onbrush, onselect }) {
  const canvas = h('canvas', { 'aria-hidden': 'true' });
  const overlay = svg('svg', { class: 'overlay', role: 'img' });
  const stage = h('div', { class: 'stage' }, canvas, overlay);
  const scroller = h('div', { class: 'scroll' }, stage);
  root.append(scroller);
  let width = 0;
  let spec = null;
  let axes = [];

  function layout() {
    const wanted = Math.max(width, (spec.columns.length - 1) * LEAST_STEP + 2 * SIDE);
    const step = spec.columns.length > 1 ? (wanted - 2 * SIDE) / (spec.columns.length - 1) : 0;
    axes = spec.columns.map((name, index) => {
      const values = spec.rows.map((row) => spec.table[name][row]);
      const domain = extent([...values, ...(spec.ranges.get(name) ?? []).filter(Number.isFinite)]);
      return { name, x: SIDE + index * step, y: linear(domain, [HEIGHT - BOTTOM, TOP]) };
    });
    return wanted;
  }

  /** Where a row crosses an axis; rows without a value cross below it. */
  const crossing = (axis, row) => {
    const value = spec.table[axis.name][row];
    return value === null || value === undefined ? HEIGHT - 8 : axis.y(value);
  };

  function strokeRows(context, rows) {
    for (let first = 0; first < rows.length; first += LINES_A_PATH) {
      context.beginPath();
      for (const row of rows.slice(first, first + LINES_A_PATH)) {
        axes.forEach((axis, index) => {
          const y = crossing(axis, row);
          if (index === 0) context.moveTo(axis.x, y);
          else context.lineTo(axis.x, y);
        });
      }
      context.stroke();
    }
  }

  function drawLines(total) {
    const context = prepareCanvas(canvas, total, HEIGHT);
    const colours = rampColours();
    const buckets = colours.map(() => []);
    const others = [];
    for (const row of spec.rows) {
      if (!spec.passes(row)) others.push(row);
      else buckets[rampIndex(spec.table[spec.colourBy][row], spec.colourDomain)].push(row);
    }
    context.lineWidth = 1;
    context.globalAlpha = 0.25;
    context.strokeStyle = colour('--line');
    strokeRows(context, others);
    context.globalAlpha = Math.max(0.04, Math.min(0.85, 400 / (spec.rows.length + 1)));
    for (let index = colours.length - 1; index >= 0; index--) {
      context.strokeStyle = colours[index];
      strokeRows(context, buckets[index]);
    }
    context.globalAlpha = 1;
    if (spec.selected !== null && spec.selected !== undefined) {
      context.strokeStyle = colour('--c2');
      context.lineWidth = 3;
      strokeRows(context, [spec.selected]);
    }
  }

  function drawAxis(axis) {
    const range = spec.ranges.get(axis.name);
    const group = svg('g', null);
    group.append(
      svg('line', { class: 'axis', x1: axis.x, x2: axis.x, y1: TOP, y2: HEIGHT - BOTTOM }),
      svg('text', { class: 'label strong', x: axis.x, y: 16, 'text-anchor': 'middle' }, spec.title(axis.name)),
    );
    for (const value of ticks(...axis.y.domain, 5)) {
      group.append(
        svg(
          'text',
          { class: 'tick outlined', x: axis.x - 5, y: axis.y(value) + 4, 'text-anchor': 'end' },
          spec.format(axis.name, value),
        ),
      );
    }
    if (range) {
      const [low, high] = range.map((end) =>
        Math.max(TOP, Math.min(HEIGHT - BOTTOM, axis.y(Math.max(-1e300, Math.min(1e300, end))))),
      );
      group.append(svg('rect', { class: 'brush', x: axis.x - 8, width: 16, y: high, height: Math.max(3, low - high) }));
    }
    group.append(
      svg('rect', {
        class: 'handle',
        'data-axis': axis.name,
        x: axis.x - 14,
        width: 28,
        y: TOP - 6,
        height: HEIGHT - TOP - BOTTOM + 12,
      }),
    );
    return group;
  }

  function draw() {
    if (width === 0 || spec === null) return;
    const total = layout();
    stage.style.width = `${total}px`;
    stage.style.height = `${HEIGHT}px`;
    drawLines(total);
    overlay.setAttribute('viewBox', `0 0 ${total} ${HEIGHT}`);
    overlay.setAttribute('width', total);
    overlay.setAttribute('height', HEIGHT);
    overlay.setAttribute('aria-label', `${spec.label} Ranges can be typed below, individuals are in the table.`);
    replace(overlay, axes.map(drawAxis));
  }

  const place = (event) => {
    const box = overlay.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  let drag = null;
  overlay.addEventListener('pointerdown', (event) => {
    const name = event.target.dataset?.axis;
    const axis = axes.find((candidate) => candidate.name === name);
    if (!axis || event.button !== 0) return;
    drag = { axis, from: place(event)[1], rect: svg('rect', { class: 'brush', x: axis.x - 8, width: 16, height: 0 }) };
    overlay.append(drag.rect);
    overlay.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  overlay.addEventListener('pointermove', (event) => {
    if (drag === null) return;
    const ends = [drag.from, place(event)[1]].sort((a, b) => a - b);
    drag.rect.setAttribute('y', ends[0]);
    drag.rect.setAttribute('height', ends[1] - ends[0]);
  });
  overlay.addEventListener('pointerup', (event) => {
    const [x, y] = place(event);
    if (drag !== null) {
      const { axis, from, rect } = drag;
      drag = null;
      rect.remove();
      if (Math.abs(y - from) >= 4) {
        const ends = [from, y].map(axis.y.invert).sort((a, b) => a - b);
        onbrush(axis.name, ends);
        return;
      }
      if (spec.ranges.has(axis.name)) {
        onbrush(axis.name, null);
        return;
      }
    }
    pick(x, y);
  });

  function pick(x, y) {
    const right = Math.max(
      1,
      axes.findIndex((axis) => axis.x >= x),
    );
    const [a, b] = [axes[right - 1], axes[right]];
    if (!a || !b) return;
    const share = (x - a.x) / (b.x - a.x);
    let best = null;
    let distance = REACH;
    for (const row of spec.rows) {
      if (!spec.passes(row)) continue;
      const [ya, yb] = [crossing(a, row), crossing(b, row)];
      const off = Math.abs(ya + (yb - ya) * share - y);
      if (off < distance) [best, distance] = [row, off];
    }
    if (best !== null) onselect(best);
  }

  const stop = onWidth(scroller, (now) => {
    width = now;
    draw();
  });

  return {
    /** Draws {rows, table (columns), columns, ranges, passes, colourBy, colourDomain, selected, label, format, title}. */
    draw(next) {
      spec = next;
      draw();
    },
    destroy() {
      stop();
    },
  };
}
