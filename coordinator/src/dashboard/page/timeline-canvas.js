// Draws the lanes of the timeline on canvases, with the load above and the time below, and tells what was clicked.

import { drawAxes, linear, ticks } from './axes.js';
import { clock, duration, moment } from './format.js';
import { colour, h, onWidth, prepareCanvas, replace, svg } from './dom.js';
import { KINDS, firstAfter, kindOf } from './lanes.js';

const LANE = 22;
const LOAD = 70;
const AXIS = 44;
const MOST_HEIGHT = 560;
const BINS = 240;
const THEME = ['text', 'muted', 'line', 'bad', 'warn', 'accent', 'hover', 'c6'];
const FONT = 'system-ui, sans-serif';

function themeColours() {
  const colours = Object.fromEntries(THEME.map((name) => [name, colour(`--${name}`)]));
  for (const [kind, { colour: name }] of Object.entries(KINDS)) colours[kind] = colour(name);
  return colours;
}

/** How many jobs are in hand on average in each part of a span of time. */
function loadOf({ columns, rows }, [low, high]) {
  const bins = new Float64Array(BINS);
  const step = (high - low) / BINS;
  const { handed_out_ms: start, ended_ms: end } = columns;
  for (let row = 0; row < rows; row++) {
    if (end[row] < low || start[row] > high) continue;
    const first = Math.max(0, Math.floor((start[row] - low) / step));
    const last = Math.min(BINS - 1, Math.floor((end[row] - low) / step));
    for (let bin = first; bin <= last; bin++) {
      const from = Math.max(start[row], low + bin * step);
      bins[bin] += Math.max(0, Math.min(end[row], low + (bin + 1) * step) - from) / step;
    }
  }
  return bins;
}

function byWorker(events) {
  const groups = new Map();
  for (const event of events) {
    if (event.worker === null) continue;
    if (!groups.has(event.worker)) groups.set(event.worker, []);
    groups.get(event.worker).push(event);
  }
  return groups;
}

/**
 * @param {HTMLElement} root
 * @param {object} on what is called: `zoom([low, high]|null)`, `job(row)`, `lane(name)`, `key(name)`, which returns
 *   whether the key means anything
 */
export function createTimelineCanvas(root, on) {
  const load = h('canvas', { class: 'load', role: 'img' });
  const canvas = h('canvas', { 'aria-hidden': 'true' });
  const spacer = h('div', null);
  const label =
    'Lanes of workers. Up and down choose a lane, left and right a job, Enter shows its row, plus and minus zoom, 0 shows all.';
  const box = h('div', { class: 'lanes', tabindex: '0', role: 'application', 'aria-label': label }, canvas, spacer);
  const axis = svg('svg', { class: 'lanes-axis', height: AXIS });
  const place = h('div', { class: 'chart' }, load, box, axis);
  root.append(place);
  let width = 0;
  let spec = null;
  let x = null;
  let drag = null;

  const left = () => (width < 600 ? 78 : 150);

  function drawLoad(colours) {
    const context = prepareCanvas(load, width, LOAD);
    const [low, high] = x.domain;
    const bins = loadOf(spec.table, x.domain);
    const step = (high - low) / BINS;
    const most = Math.max(1, ...bins);
    const y = linear([0, most], [LOAD - 2, 14]);
    context.fillStyle = colours.c6;
    bins.forEach((value, bin) => {
      const from = x(low + bin * step);
      context.fillRect(from, y(value), Math.max(1, x(low + (bin + 1) * step) - from), LOAD - 2 - y(value));
    });
    context.fillStyle = colours.muted;
    context.font = `11.5px ${FONT}`;
    context.fillText('Jobs in hand', 4, LOAD / 2);
    context.fillText(`≤ ${most.toFixed(most < 10 ? 1 : 0)}`, 4, LOAD / 2 + 15);
    const text = `Jobs in hand of all workers, at most ${most.toFixed(1)} at once, from ${clock(low)} to ${clock(high)}.`;
    load.setAttribute('aria-label', text);
  }

  /** One job: pale while in hand, solid while computing, an outline if it never reported. */
  function drawJob(context, row, y, tall, from, to, colours) {
    const { columns } = spec.table;
    const kind = kindOf(columns.end[row]);
    const bright = spec.bright(row);
    const high = Math.max(1, tall - 1);
    const ran = columns.run_seconds[row];
    context.fillStyle = colours[kind];
    context.globalAlpha = bright ? 0.35 : 0.08;
    context.fillRect(from, y, to - from, high);
    context.globalAlpha = bright ? 1 : 0.15;
    if (ran !== null) {
      const begun = Math.max(from, to - Math.max(1, x(x.domain[0] + ran * 1000) - x(x.domain[0])));
      context.fillRect(begun, y, to - begun, high);
    } else context.strokeRect(from + 0.5, y + 0.5, Math.max(1, to - from - 1), Math.max(1, tall - 2));
    const { symbol } = KINDS[kind];
    if (symbol !== '' && tall > 7) {
      context.fillStyle = colours.text;
      context.font = `bold 11px ${FONT}`;
      context.fillText(symbol, Math.min(to + 1, width - 10), y + tall / 2 + 4);
    }
    context.globalAlpha = 1;
    if (row !== spec.selected) return;
    context.strokeStyle = colours.text;
    context.lineWidth = 2;
    context.strokeRect(from - 1, y - 1, to - from + 2, tall + 1);
    context.lineWidth = 1;
    context.strokeStyle = colours.muted;
  }

  function drawLane(context, lane, top, colours) {
    const { columns } = spec.table;
    const [low, high] = x.domain;
    const tall = (LANE - 5) / lane.height;
    const reached = new Float64Array(lane.height).fill(-Infinity);
    for (let at = firstAfter(lane, columns, low); at < lane.rows.length; at++) {
      const row = lane.rows[at];
      if (columns.handed_out_ms[row] > high) break;
      if (columns.ended_ms[row] < low) continue;
      const slot = lane.slots[at];
      const from = Math.max(left(), x(columns.handed_out_ms[row]));
      const to = Math.max(from + 1, Math.min(width, x(columns.ended_ms[row])));
      // What would cover the same pixel is left out, unless it is something rare.
      const common = columns.end[row] === 'answered' && row !== spec.selected;
      if (common && to < reached[slot] + 0.7) continue;
      reached[slot] = to;
      drawJob(context, row, top + 2 + slot * tall, tall, from, to, colours);
    }
  }

  function drawEvents(context, top, events, colours) {
    for (const event of events) {
      const at = x(event.at_ms);
      if (at < left() || at > width) continue;
      context.fillStyle = event.level === 'error' ? colours.bad : colours.warn;
      context.beginPath();
      context.moveTo(at - 5, top + 1);
      context.lineTo(at + 5, top + 1);
      context.lineTo(at, top + 9);
      context.fill();
    }
  }

  function drawName(context, name, top, colours) {
    context.fillStyle = name === spec.worker ? colours.accent : colours.text;
    context.font = `12px ${FONT}`;
    context.save();
    context.beginPath();
    context.rect(0, top, left() - 6, LANE);
    context.clip();
    context.fillText(name, 5, top + 15);
    context.restore();
  }

  function drawLanes(colours) {
    const { names } = spec;
    const height = Math.min(MOST_HEIGHT, Math.max(LANE, names.length * LANE));
    box.style.height = `${height + 2}px`;
    spacer.style.height = `${Math.max(0, names.length * LANE - height)}px`;
    const context = prepareCanvas(canvas, width - 2, height);
    context.strokeStyle = colours.muted;
    const first = Math.floor(box.scrollTop / LANE);
    const events = byWorker(spec.events);
    for (let at = first; at < Math.min(names.length, first + Math.ceil(height / LANE) + 1); at++) {
      const name = names[at];
      const top = at * LANE - box.scrollTop;
      if (name === spec.worker) {
        context.fillStyle = colours.hover;
        context.fillRect(0, top, width, LANE);
      }
      context.fillStyle = colours.line;
      context.fillRect(0, top + LANE - 1, width, 1);
      drawLane(context, spec.lane(name), top, colours);
      drawEvents(context, top, events.get(name) ?? [], colours);
      drawName(context, name, top, colours);
    }
  }

  function drawTime() {
    const [low, high] = x.domain;
    const begin = spec.span[0];
    const since = (at) => (at - begin) / 1000;
    const fine = high - low < 5000;
    const steps = ticks(since(low), since(high), Math.max(2, (width - left()) / 110));
    axis.setAttribute('width', width);
    axis.setAttribute('viewBox', `0 0 ${width} ${AXIS}`);
    replace(
      axis,
      drawAxes({
        x,
        y: linear([0, 1], [2, 2]),
        xTitle: `Time since ${moment(begin)}`,
        yTitle: '',
        xFormat: (at) => (fine ? `${since(at).toFixed(3)} s` : duration(Math.max(0, Math.round(since(at))))),
        yFormat: () => '',
        xTicks: steps.map((seconds) => begin + seconds * 1000),
        yTicks: [],
      }),
    );
  }

  function draw() {
    if (spec === null || width === 0) return;
    x = linear(spec.domain, [left(), width - 4]);
    const colours = themeColours();
    drawLoad(colours);
    drawLanes(colours);
    drawTime();
  }

  const position = (event) => {
    const bounds = canvas.getBoundingClientRect();
    return [event.clientX - bounds.left, event.clientY - bounds.top];
  };

  function pick(px, py) {
    const down = py + box.scrollTop;
    const name = spec.names[Math.floor(down / LANE)];
    if (name === undefined) return;
    if (px < left()) {
      on.lane(name);
      return;
    }
    const { columns } = spec.table;
    const lane = spec.lane(name);
    const slot = Math.floor((((down % LANE) - 2) / (LANE - 5)) * lane.height);
    let [best, distance] = [null, 8];
    lane.rows.forEach((row, at) => {
      const [from, to] = [x(columns.handed_out_ms[row]), x(columns.ended_ms[row])];
      const off = Math.max(0, from - px, px - to) + Math.abs(lane.slots[at] - slot) * 2;
      if (off < distance) [best, distance] = [row, off];
    });
    if (best !== null) on.job(best);
  }

  canvas.addEventListener('pointerdown', (event) => {
    if (x === null || event.button !== 0) return;
    drag = position(event);
    if (event.pointerType !== 'touch') canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (drag === null || event.pointerType === 'touch') return;
    const [px] = position(event);
    drawLanes(themeColours());
    const context = canvas.getContext('2d');
    context.globalAlpha = 0.2;
    context.fillStyle = colour('--accent');
    context.fillRect(Math.min(px, drag[0]), 0, Math.abs(px - drag[0]), canvas.height);
    context.globalAlpha = 1;
  });
  canvas.addEventListener('pointerup', (event) => {
    if (drag === null) return;
    const from = drag;
    drag = null;
    const [px, py] = position(event);
    if (Math.abs(px - from[0]) < 5) pick(px, py);
    else if (event.pointerType !== 'touch') {
      on.zoom([from[0], px].map((at) => x.invert(Math.max(left(), at))).sort((a, b) => a - b));
    }
  });
  canvas.addEventListener('dblclick', () => on.zoom(null));
  box.addEventListener('scroll', () => requestAnimationFrame(() => x !== null && drawLanes(themeColours())));
  box.addEventListener('keydown', (event) => {
    if (spec !== null && event.target === box && on.key(event.key)) event.preventDefault();
  });

  const stop = onWidth(place, (now) => {
    width = now;
    draw();
  });

  return {
    /**
     * Draws {table, names of the lanes in order, lane(name), domain and span in milliseconds, events, worker chosen,
     * selected row, bright(row)}.
     */
    draw(next) {
      spec = next;
      draw();
    },
    /** Scrolls a lane into sight. */
    sight(name) {
      const at = spec?.names.indexOf(name) ?? -1;
      if (at < 0) return;
      const height = box.clientHeight;
      if (at * LANE < box.scrollTop) box.scrollTop = at * LANE;
      else if ((at + 1) * LANE > box.scrollTop + height) box.scrollTop = (at + 1) * LANE - height;
    },
    destroy() {
      stop();
    },
  };
}
