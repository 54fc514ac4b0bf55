// Scales and ticks, and the axes of a chart drawn in SVG.

import { svg } from './dom.js';

/** Round values between two ends, about `wanted` of them, at least `least` apart. */
export function ticks(low, high, wanted, least = 0) {
  if (!(high > low)) return [low];
  const raw = Math.max(least, (high - low) / Math.max(1, wanted));
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= raw * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  const values = [];
  for (let index = first; index * step <= high + step * 1e-9; index++)
    values.push(Number((index * step).toPrecision(12)));
  return values;
}

/** A linear map from a domain to a range of pixels; `invert` goes back. */
export function linear([d0, d1], [r0, r1]) {
  const span = d1 - d0 || 1;
  const map = (value) => r0 + ((value - d0) / span) * (r1 - r0);
  map.invert = (pixel) => d0 + ((pixel - r0) / (r1 - r0 || 1)) * span;
  map.domain = [d0, d1];
  map.range = [r0, r1];
  return map;
}

/** The ends of some values, a little wider; from `zero` on if it is given. */
export function extent(values, { margin = 0.04, zero = false } = {}) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null || value === undefined || Number.isNaN(value)) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return [0, 1];
  if (zero) low = Math.min(low, 0);
  if (low === high) {
    const half = Math.abs(low) * 0.05 || 0.5;
    return [low - half, high + half];
  }
  const room = (high - low) * margin;
  return [zero && low === 0 ? 0 : low - room, high + room];
}

/**
 * Axes, grid lines and titles.
 * @param {{x: function, y: function, xTitle: string, yTitle: string, xFormat: function, yFormat: function,
 *   xTicks?: number[], yTicks?: number[], xLeast?: number}} options `x` and `y` from {@link linear}
 */
export function drawAxes({ x, y, xTitle, yTitle, xFormat, yFormat, xTicks, yTicks, xLeast }) {
  const [left, right] = x.range;
  const [bottom, top] = y.range;
  const group = svg('g', { class: 'axes', 'aria-hidden': 'true' });
  for (const value of yTicks ?? ticks(...y.domain, Math.max(2, (bottom - top) / 48))) {
    const at = Math.round(y(value)) + 0.5;
    group.append(
      svg('line', { class: 'grid', x1: left, x2: right, y1: at, y2: at }),
      svg('text', { class: 'tick', x: left - 6, y: at + 4, 'text-anchor': 'end' }, yFormat(value)),
    );
  }
  for (const value of xTicks ?? ticks(...x.domain, Math.max(2, (right - left) / 90), xLeast)) {
    const at = Math.round(x(value)) + 0.5;
    group.append(
      svg('line', { class: 'tickmark', x1: at, x2: at, y1: bottom, y2: bottom + 4 }),
      svg('text', { class: 'tick', x: at, y: bottom + 17, 'text-anchor': 'middle' }, xFormat(value)),
    );
  }
  group.append(
    svg('line', { class: 'axis', x1: left, x2: right, y1: bottom + 0.5, y2: bottom + 0.5 }),
    svg('text', { class: 'axis-title', x: (left + right) / 2, y: bottom + 34, 'text-anchor': 'middle' }, xTitle),
    svg(
      'text',
      {
        class: 'axis-title',
        x: left - 6,
        y: top - 8,
        'text-anchor': left > 70 ? 'middle' : 'start',
        dx: left > 70 ? 0 : -left + 8,
      },
      yTitle,
    ),
  );
  return group;
}

/** The path of a symbol about a point: what tells series apart without colour. */
export function symbolPath(kind, x, y, r = 4) {
  switch (kind) {
    case 'square':
      return `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`;
    case 'triangle':
      return `M${x} ${y - r * 1.2}L${x + r * 1.1} ${y + r * 0.8}H${x - r * 1.1}z`;
    case 'diamond':
      return `M${x} ${y - r * 1.3}L${x + r * 1.3} ${y}L${x} ${y + r * 1.3}L${x - r * 1.3} ${y}z`;
    case 'cross':
      return `M${x - r} ${y - r}l${2 * r} ${2 * r}M${x + r} ${y - r}l${-2 * r} ${2 * r}`;
    default:
      return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
  }
}
