// A chart of lines, bands and level lines in SVG: zoom by dragging, keys or buttons, a readout, the data as a table.

import { drawAxes, extent, linear, symbolPath } from './axes.js';
import { h, onWidth, replace, setText, svg } from './dom.js';

const MARGIN = { top: 26, right: 14, bottom: 42, left: 58 };

const path = (points, x, y) =>
  points.map(([px, py], index) => `${index === 0 ? 'M' : 'L'}${x(px).toFixed(1)} ${y(py).toFixed(1)}`).join('');

function bandPath(points, x, y) {
  const back = [...points].reverse().map(([px, low]) => [px, low]);
  return points.length < 2
    ? ''
    : `${path(
        points.map(([px, , high]) => [px, high]),
        x,
        y,
      )}${path(back, x, y).replace('M', 'L')}z`;
}

/** Parts of a line without the points that have no value. */
function parts(points) {
  const all = [];
  let open = [];
  for (const point of points) {
    if (point[1] === null || point[1] === undefined) {
      if (open.length > 0) all.push(open);
      open = [];
    } else open.push(point);
  }
  if (open.length > 0) all.push(open);
  return all;
}

function sample({ colour, dash, symbol, band, only }) {
  const stroke = { style: { stroke: `var(${colour})`, fill: 'none' }, 'stroke-dasharray': dash ?? '' };
  return svg(
    'svg',
    { class: 'sample', width: 28, height: 12, 'aria-hidden': 'true' },
    band && svg('rect', { x: 1, y: 1, width: 26, height: 10, style: { fill: `var(${colour})` }, opacity: 0.25 }),
    !band && !only && svg('line', { x1: 1, x2: 27, y1: 6, y2: 6, 'stroke-width': 2, ...stroke }),
    symbol &&
      svg('path', { d: symbolPath(symbol, 14, 6, 4), style: { fill: `var(${colour})`, stroke: `var(${colour})` } }),
  );
}

/** The nearest of sorted numbers. */
function nearest(sorted, value) {
  let best = null;
  for (const candidate of sorted)
    if (best === null || Math.abs(candidate - value) < Math.abs(best - value)) best = candidate;
  return best;
}

/**
 * A chart. `draw` takes {label, x: {title, format, domain?}, y: {title, format, zero?}, series: [{name, colour, dash?,
 * symbol?, only?, points: [[x, y]]}], bands: [{name, colour, points: [[x, low, high]]}], lines: [{name, y, colour,
 * dash?}]}; `symbol` with `only` draws no line.
 * @param {HTMLElement} root
 * @param {{height: number, onzoom: function([number, number]|null): void}} options `onzoom` keeps the domain
 */
export function createChart(root, { height, onzoom }) {
  const picture = svg('svg', { class: 'plot', role: 'img', tabindex: '0', height });
  const readout = h('p', { class: 'readout', 'aria-live': 'polite' });
  const legend = h('ul', { class: 'legend' });
  const data = h('div', { class: 'scroll' });
  const details = h(
    'details',
    { class: 'data', ontoggle: () => tabulate() },
    h('summary', null, 'Data as a table'),
    data,
  );
  const button = (text, label, act) =>
    h('button', { class: 'small', title: label, 'aria-label': label, onclick: act }, text);
  const tools = h(
    'div',
    { class: 'plot-tools' },
    button('+', 'Zoom in', () => zoom(0.5)),
    button('−', 'Zoom out', () => zoom(2)),
    button('Whole', 'Show the whole range', () => onzoom(null)),
  );
  const figure = h('figure', { class: 'chart' }, tools, picture, legend, readout, details);
  root.append(figure);
  let width = 0;
  let spec = null;
  let scales = null;
  let positions = [];
  let cursor = null;

  const whole = () =>
    extent(
      [...spec.series, ...spec.bands].flatMap(({ points }) => points.map(([x]) => x)),
      { margin: 0.01 },
    );

  function zoom(factor) {
    const [low, high] = scales.x.domain;
    const middle = cursor ?? (low + high) / 2;
    const [least, most] = whole();
    const next = [Math.max(least, middle - (middle - low) * factor), Math.min(most, middle + (high - middle) * factor)];
    onzoom(next[0] <= least && next[1] >= most ? null : next);
  }

  function tabulate() {
    if (!details.open || spec === null) return;
    const head = [spec.x.title, ...spec.series.map(({ name }) => name), ...spec.bands.map(({ name }) => name)];
    const columns = spec.series.map(({ points }) => new Map(points));
    const ranges = spec.bands.map(({ points }) => new Map(points.map(([x, low, high]) => [x, [low, high]])));
    const shown = positions.slice(-1000);
    const rows = shown.map((x) =>
      h(
        'tr',
        null,
        h('th', { scope: 'row' }, spec.x.format(x)),
        columns.map((column) => h('td', null, column.has(x) ? spec.y.format(column.get(x)) : '')),
        ranges.map((range) => h('td', null, range.has(x) ? range.get(x).map(spec.y.format).join(' to ') : '')),
      ),
    );
    const levels = spec.lines.map(({ name, y }) => `${name}: ${spec.y.format(y)}`).join('; ');
    replace(
      data,
      levels && h('p', null, levels),
      positions.length > shown.length && h('p', null, `The last ${shown.length} of ${positions.length} rows.`),
      h(
        'table',
        null,
        h(
          'thead',
          null,
          h(
            'tr',
            null,
            head.map((text) => h('th', { scope: 'col' }, text)),
          ),
        ),
        h('tbody', null, rows),
      ),
    );
  }

  function point(at) {
    cursor = at;
    figure.querySelector('.cursor')?.remove();
    if (at === null) {
      setText(readout, '');
      return;
    }
    const px = scales.x(at);
    picture.append(svg('line', { class: 'cursor', x1: px, x2: px, y1: scales.y.range[1], y2: scales.y.range[0] }));
    const said = spec.series
      .map(({ name, points }) => [name, points.find(([x]) => x === at)?.[1]])
      .filter(([, y]) => y !== undefined && y !== null)
      .map(([name, y]) => `${name} ${spec.y.format(y)}`);
    const ranges = spec.bands
      .map(({ name, points }) => [name, points.find(([x]) => x === at)])
      .filter(([, found]) => found)
      .map(([name, [, low, high]]) => `${name} ${spec.y.format(low)} to ${spec.y.format(high)}`);
    setText(readout, `${spec.x.title} ${spec.x.format(at)}: ${[...said, ...ranges].join('; ')}`);
  }

  function levelLabels(x, y) {
    const placed = [];
    const group = svg('g', { 'aria-hidden': 'true' });
    for (const line of [...spec.lines].sort((a, b) => b.y - a.y)) {
      const at = y(line.y);
      if (at < y.range[1] - 1 || at > y.range[0] + 1) continue;
      let text = at - 4;
      for (const other of placed) if (text < other + 13) text = other + 13;
      placed.push(text);
      group.append(
        svg('line', {
          class: 'level',
          x1: x.range[0],
          x2: x.range[1],
          y1: at,
          y2: at,
          'stroke-dasharray': line.dash ?? '6 4',
          style: { stroke: `var(${line.colour})` },
        }),
        svg(
          'text',
          { class: 'level-name', x: x.range[1] - 4, y: text, 'text-anchor': 'end' },
          `${line.name} ${spec.y.format(line.y)}`,
        ),
      );
    }
    return group;
  }

  function draw() {
    if (width === 0 || spec === null) return;
    const domain = spec.x.domain ?? whole();
    const inside = ([px]) => px >= domain[0] && px <= domain[1];
    const values = [
      ...spec.series.flatMap(({ points }) => points.filter(inside).map(([, y]) => y)),
      ...spec.bands.flatMap(({ points }) => points.filter(inside).flatMap(([, low, high]) => [low, high])),
      ...spec.lines.map(({ y }) => y),
    ];
    const x = linear(domain, [MARGIN.left, width - MARGIN.right]);
    const y = linear(extent(values, { zero: spec.y.zero }), [height - MARGIN.bottom, MARGIN.top]);
    scales = { x, y };
    positions = [...new Set([...spec.series, ...spec.bands].flatMap(({ points }) => points.map(([px]) => px)))]
      .filter((px) => inside([px]))
      .sort((a, b) => a - b);
    picture.setAttribute('viewBox', `0 0 ${width} ${height}`);
    picture.setAttribute('width', width);
    picture.setAttribute('aria-label', `${spec.label} Arrow keys read values, plus and minus zoom.`);
    const box = {
      x: x.range[0],
      y: y.range[1] - 3,
      width: x.range[1] - x.range[0],
      height: y.range[0] - y.range[1] + 6,
    };
    const clip = `clip-${(createChart.made = (createChart.made ?? 0) + 1)}`;
    const marks = svg('g', { 'clip-path': `url(#${clip})`, 'aria-hidden': 'true' });
    for (const { colour, points } of spec.bands) {
      marks.append(svg('path', { class: 'band', d: bandPath(points, x, y), style: { fill: `var(${colour})` } }));
    }
    for (const { colour, dash, symbol, only, thin, points } of spec.series) {
      for (const part of only ? [] : parts(points)) {
        marks.append(
          svg('path', {
            class: thin ? 'line thin' : 'line',
            d: path(part, x, y),
            'stroke-dasharray': dash ?? '',
            style: { stroke: `var(${colour})` },
          }),
        );
      }
      if (!symbol) continue;
      const shown = points.filter((p) => inside(p) && p[1] !== null && p[1] !== undefined);
      const every = only ? 1 : Math.max(1, Math.ceil(shown.length / 30));
      const d = shown
        .filter((_, index) => index % every === 0)
        .map(([px, py]) => symbolPath(symbol, x(px), y(py), only ? 5 : 3.2))
        .join('');
      marks.append(svg('path', { d, class: 'symbol', style: { fill: `var(${colour})`, stroke: `var(${colour})` } }));
    }
    replace(
      picture,
      svg('defs', null, svg('clipPath', { id: clip }, svg('rect', box))),
      drawAxes({
        x,
        y,
        xTitle: spec.x.title,
        yTitle: spec.y.title,
        xFormat: spec.x.format,
        yFormat: spec.y.format,
        xLeast: spec.x.least,
      }),
      marks,
      levelLabels(x, y),
    );
    const entry = (item) => h('li', null, sample(item), item.name);
    replace(
      legend,
      spec.series.filter((item) => item.legend !== false).map(entry),
      spec.bands.map((item) => entry({ ...item, band: true })),
      spec.lines.map((item) => entry({ dash: '6 4', ...item, name: `${item.name} ${spec.y.format(item.y)}` })),
    );
    if (cursor !== null) point(nearest(positions, cursor));
    tabulate();
  }

  let from = null;
  const at = (event) => event.clientX - picture.getBoundingClientRect().left;
  picture.addEventListener('pointerdown', (event) => {
    if (scales === null || event.button !== 0 || event.pointerType === 'touch') return;
    from = at(event);
    picture.setPointerCapture(event.pointerId);
  });
  picture.addEventListener('pointermove', (event) => {
    if (scales === null) return;
    picture.querySelector('.zooming')?.remove();
    if (from === null || Math.abs(at(event) - from) < 5) {
      point(nearest(positions, scales.x.invert(at(event))));
      return;
    }
    const [low, high] = [Math.min(from, at(event)), Math.max(from, at(event))];
    picture.append(
      svg('rect', {
        class: 'zooming',
        x: low,
        width: high - low,
        y: scales.y.range[1],
        height: scales.y.range[0] - scales.y.range[1],
      }),
    );
  });
  picture.addEventListener('pointerup', (event) => {
    picture.querySelector('.zooming')?.remove();
    if (from !== null && Math.abs(at(event) - from) >= 5) {
      const ends = [from, at(event)].map(scales.x.invert).sort((a, b) => a - b);
      onzoom([Math.max(ends[0], whole()[0]), Math.min(ends[1], whole()[1])]);
    }
    from = null;
  });
  picture.addEventListener('pointerleave', () => point(null));
  picture.addEventListener('dblclick', () => onzoom(null));
  picture.addEventListener('keydown', (event) => {
    if (scales === null || positions.length === 0) return;
    const index = cursor === null ? -1 : positions.indexOf(nearest(positions, cursor));
    if (event.key === 'ArrowRight') point(positions[Math.min(positions.length - 1, index + 1)]);
    else if (event.key === 'ArrowLeft') point(positions[Math.max(0, index === -1 ? positions.length - 1 : index - 1)]);
    else if (event.key === 'Home') point(positions[0]);
    else if (event.key === 'End') point(positions[positions.length - 1]);
    else if (event.key === '+' || event.key === '=') zoom(0.5);
    else if (event.key === '-') zoom(2);
    else if (event.key === '0' || event.key === 'Escape') onzoom(null);
    else return;
    event.preventDefault();
  });

  const stop = onWidth(figure, (now) => {
    width = now;
    draw();
  });

  return {
    draw(next) {
      spec = next;
      draw();
    },
    destroy() {
      stop();
      figure.remove();
    },
  };
}
