// Who did what when: a lane for each worker with its jobs, audits and losses.

import { drawAxes, linear, ticks } from './axes.js';
import { passingWorkers } from './brush.js';
import { choice, colour, h, onWidth, prepareCanvas, replace, setText, svg } from './dom.js';
import { clock, count, duration, moment, plural } from './format.js';
import { KINDS, createLanes, firstAfter, kindOf } from './lanes.js';
import { createTable } from './table.js';

const LANE = 22;
const LOAD = 70;
const AXIS = 44;
const MOST_HEIGHT = 560;
const BINS = 240;
/** Above so many attempts, the table follows the stream more slowly than the lanes. */
const MANY = 20_000;
const TABLE_PAUSE = 3000;
const AUDITS = new Set(['agreed', 'disagreed']);

export const view = {
  id: 'timeline',
  title: 'Timeline',
  create(root, context) {
    const { store, state } = context;
    const lanes = createLanes();
    const summary = h('p', { class: 'muted', role: 'status' });
    const tools = h('div', { class: 'row' });
    const load = h('canvas', { class: 'load', role: 'img' });
    const canvas = h('canvas', { 'aria-hidden': 'true' });
    const spacer = h('div', null);
    const box = h(
      'div',
      {
        class: 'lanes',
        tabindex: '0',
        role: 'application',
        'aria-label':
          'Lanes of workers. Up and down choose a lane, left and right a job, Enter shows its row, plus and minus zoom, 0 shows all.',
      },
      canvas,
      spacer,
    );
    const axisBox = svg('svg', { class: 'lanes-axis', height: AXIS });
    const place = h('div', { class: 'chart' }, load, box, axisBox);
    const legend = h('ul', { class: 'legend' });
    const facts = h('div', { 'aria-live': 'polite' });
    const tablePlace = h('div', null);
    replace(
      root,
      h(
        'section',
        { class: 'panel' },
        h('h2', null, 'Timeline'),
        summary,
        tools,
        place,
        legend,
        h('p', { class: 'muted' }, 'Drag to zoom in time, click a job for its row. Pale: in hand; solid: computing.'),
      ),
      h('section', { class: 'panel' }, h('h2', null, 'Job'), facts),
      h('section', { class: 'panel' }, h('h2', null, 'Attempts'), tablePlace),
    );
    let width = 0;
    let names = [];
    let x = null;
    let passing = null;
    let passingJobs = null;
    let drag = null;
    let toolsKey = '';

    const columns = () => store.attempts.columns;
    const selectedRow = () => {
      const wanted = Number(state.get('attempt') ?? NaN);
      return Number.isNaN(wanted) ? -1 : columns().sequence.indexOf(wanted);
    };
    const left = () => (width < 600 ? 78 : 150);

    function domain() {
      const ends = (state.get('t') ?? '').split('..').map(Number);
      if (ends.length === 2 && ends[1] > ends[0]) return ends;
      const [low, high] = lanes.span();
      return high > low ? [low, high + (high - low) * 0.01] : [low - 500, low + 500];
    }

    const setDomain = (ends) => state.set({ t: ends === null ? null : ends.map(Math.round).join('..') });

    function zoom(factor) {
      const [low, high] = domain();
      const row = selectedRow();
      const middle = row >= 0 ? columns().handed_out_ms[row] : (low + high) / 2;
      setDomain([middle - (middle - low) * factor, middle + (high - middle) * factor]);
    }

    const show = () => state.get('show') ?? 'all';
    const wanted = (row) => {
      const kind = kindOf(columns().end[row]);
      if (show() === 'audits' && !AUDITS.has(kind)) return false;
      if (show() === 'losses' && !['lost', 'failed', 'late', 'disagreed'].includes(kind)) return false;
      return passingJobs === null || passingJobs.has(`${columns().worker[row]} ${columns().run_seconds[row]}`);
    };

    /** The jobs of the brushed individuals, by worker and time on it, which both tables have. */
    function readPassing() {
      passing = passingWorkers(store);
      passingJobs = null;
      if (passing === null) return;
      passingJobs = new Set();
      const of = store.individuals.columns;
      for (let row = 0; row < store.individuals.rows; row++) {
        if (of.worker[row] !== null && store.passes(row)) passingJobs.add(`${of.worker[row]} ${of.run_seconds[row]}`);
      }
    }

    function listNames() {
      const words = (state.get('wfind') ?? '').toLowerCase();
      const chosen = state.get('worker');
      names = lanes
        .names()
        .filter(
          (name) => name.toLowerCase().includes(words) && (passing === null || passing.has(name) || name === chosen),
        );
    }

    function drawLoad() {
      const context2d = prepareCanvas(load, width, LOAD);
      const [low, high] = x.domain;
      const bins = new Float64Array(BINS);
      const step = (high - low) / BINS;
      const { handed_out_ms: start, ended_ms: end } = columns();
      for (let row = 0; row < store.attempts.rows; row++) {
        if (end[row] < low || start[row] > high) continue;
        const first = Math.max(0, Math.floor((start[row] - low) / step));
        const last = Math.min(BINS - 1, Math.floor((end[row] - low) / step));
        for (let bin = first; bin <= last; bin++) {
          const from = Math.max(start[row], low + bin * step);
          bins[bin] += Math.max(0, Math.min(end[row], low + (bin + 1) * step) - from) / step;
        }
      }
      const most = Math.max(1, ...bins);
      const y = linear([0, most], [LOAD - 2, 14]);
      context2d.fillStyle = colour('--c6');
      bins.forEach((value, bin) => {
        const from = x(low + bin * step);
        context2d.fillRect(from, y(value), Math.max(1, x(low + (bin + 1) * step) - from), LOAD - 2 - y(value));
      });
      context2d.fillStyle = colour('--muted');
      context2d.font = '11.5px system-ui, sans-serif';
      context2d.fillText('Jobs in hand', 4, LOAD / 2);
      context2d.fillText(`≤ ${most.toFixed(most < 10 ? 1 : 0)}`, 4, LOAD / 2 + 15);
      load.setAttribute(
        'aria-label',
        `Jobs in hand of all workers, at most ${most.toFixed(1)} at once, from ${clock(low)} to ${clock(high)}.`,
      );
    }

    function drawLane(context2d, lane, top, colours, selected) {
      const of = columns();
      const [low, high] = x.domain;
      const tall = (LANE - 5) / lane.height;
      const reached = new Float64Array(lane.height).fill(-Infinity);
      for (let at = firstAfter(lane, of, low); at < lane.rows.length; at++) {
        const row = lane.rows[at];
        const start = of.handed_out_ms[row];
        if (start > high) break;
        if (of.ended_ms[row] < low) continue;
        const slot = lane.slots[at];
        const from = Math.max(left(), x(start));
        const to = Math.max(from + 1, Math.min(width, x(of.ended_ms[row])));
        const kind = kindOf(of.end[row]);
        // What would cover the same pixel is left out, unless it is something rare.
        if (kind === 'answered' && to < reached[slot] + 0.7 && row !== selected) continue;
        reached[slot] = to;
        const y = top + 2 + slot * tall;
        const bright = wanted(row);
        context2d.fillStyle = colours[kind];
        context2d.globalAlpha = bright ? 0.35 : 0.08;
        context2d.fillRect(from, y, to - from, Math.max(1, tall - 1));
        const ran = of.run_seconds[row];
        const begun = ran === null ? to : Math.max(from, to - Math.max(1, x(low + ran * 1000) - x(low)));
        context2d.globalAlpha = bright ? 1 : 0.15;
        if (ran !== null) context2d.fillRect(begun, y, to - begun, Math.max(1, tall - 1));
        else context2d.strokeRect(from + 0.5, y + 0.5, Math.max(1, to - from - 1), Math.max(1, tall - 2));
        const { symbol } = KINDS[kind];
        if (symbol !== '' && tall > 7) {
          context2d.fillStyle = colours.text;
          context2d.font = 'bold 11px system-ui, sans-serif';
          context2d.fillText(symbol, Math.min(to + 1, width - 10), y + tall / 2 + 4);
        }
        context2d.globalAlpha = 1;
        if (row === selected) {
          context2d.strokeStyle = colours.text;
          context2d.lineWidth = 2;
          context2d.strokeRect(from - 1, y - 1, to - from + 2, tall + 1);
          context2d.lineWidth = 1;
          context2d.strokeStyle = colours.muted;
        }
      }
    }

    function drawEvents(context2d, top, worker, colours) {
      for (const event of store.events ?? []) {
        if (event.worker !== worker) continue;
        const at = x(event.at_ms);
        if (at < left() || at > width) continue;
        context2d.fillStyle = event.level === 'error' ? colours.bad : colours.warn;
        context2d.beginPath();
        context2d.moveTo(at - 5, top + 1);
        context2d.lineTo(at + 5, top + 1);
        context2d.lineTo(at, top + 9);
        context2d.fill();
      }
    }

    function drawLanes() {
      const height = Math.min(MOST_HEIGHT, Math.max(LANE, names.length * LANE));
      box.style.height = `${height + 2}px`;
      spacer.style.height = `${Math.max(0, names.length * LANE - height)}px`;
      const context2d = prepareCanvas(canvas, width - 2, height);
      const colours = Object.fromEntries(Object.entries(KINDS).map(([kind, { colour: name }]) => [kind, colour(name)]));
      for (const name of ['text', 'muted', 'line', 'bad', 'warn', 'accent', 'hover'])
        colours[name] = colour(`--${name}`);
      context2d.strokeStyle = colours.muted;
      const selected = selectedRow();
      const first = Math.floor(box.scrollTop / LANE);
      for (let at = first; at < Math.min(names.length, first + Math.ceil(height / LANE) + 1); at++) {
        const top = at * LANE - box.scrollTop;
        if (names[at] === state.get('worker')) {
          context2d.fillStyle = colours.hover;
          context2d.fillRect(0, top, width, LANE);
        }
        context2d.fillStyle = colours.line;
        context2d.fillRect(0, top + LANE - 1, width, 1);
        drawLane(context2d, lanes.of(names[at], columns()), top, colours, selected);
        drawEvents(context2d, top, names[at], colours);
        context2d.fillStyle = names[at] === state.get('worker') ? colours.accent : colours.text;
        context2d.font = '12px system-ui, sans-serif';
        context2d.save();
        context2d.beginPath();
        context2d.rect(0, top, left() - 6, LANE);
        context2d.clip();
        context2d.fillText(names[at], 5, top + 15);
        context2d.restore();
      }
    }

    function timeTicks() {
      const [low, high] = x.domain;
      const steps = ticks(0, (high - low) / 1000, Math.max(2, (width - left()) / 110));
      return steps.map((seconds) => low + seconds * 1000).filter((at) => at <= high);
    }

    function draw() {
      if (store.attempts === null || width === 0 || lanes.span()[1] < lanes.span()[0]) return;
      x = linear(domain(), [left(), width - 4]);
      drawLoad();
      drawLanes();
      const { span } = lanes;
      const fine = x.domain[1] - x.domain[0] < 5000;
      axisBox.setAttribute('width', width);
      axisBox.setAttribute('viewBox', `0 0 ${width} ${AXIS}`);
      const axis = drawAxes({
        x,
        y: linear([0, 1], [2, 2]),
        xTitle: `Time since ${moment(span()[0])}`,
        yTitle: '',
        xFormat: (at) =>
          fine
            ? `${((at - span()[0]) / 1000).toFixed(3)} s`
            : duration(Math.max(0, Math.round((at - span()[0]) / 1000))),
        yFormat: () => '',
        xTicks: timeTicks(),
        yTicks: [],
      });
      replace(axisBox, axis);
    }

    function drawTools() {
      const key = JSON.stringify([show(), state.get('t'), state.get('worker'), lanes.names().length]);
      if (key === toolsKey) return;
      toolsKey = key;
      const search = h('input', {
        type: 'search',
        value: state.get('wfind') ?? '',
        oninput: (event) => state.set({ wfind: event.target.value }),
      });
      const focused = tools.contains(document.activeElement) && document.activeElement.type === 'search';
      const button = (text, label, act) => h('button', { 'aria-label': label, title: label, onclick: act }, text);
      replace(
        tools,
        h('label', { class: 'field' }, 'Workers', search),
        choice(
          'Jobs',
          [
            ['all', 'all'],
            ['audits', 'audits'],
            ['losses', 'losses and disagreements'],
          ],
          show(),
          (value) => state.set({ show: value === 'all' ? null : value }),
        ),
        button('+', 'Zoom in', () => zoom(0.5)),
        button('−', 'Zoom out', () => zoom(2)),
        button('Whole', 'Show the whole time', () => setDomain(null)),
        state.get('worker') &&
          button(`Lane of ${state.get('worker')} ✕`, 'No lane chosen', () => state.set({ worker: null })),
      );
      if (focused) search.focus();
    }

    function drawLegend() {
      const counts = {};
      for (const end of columns().end) counts[kindOf(end)] = (counts[kindOf(end)] ?? 0) + 1;
      replace(
        legend,
        Object.entries(KINDS).map(([kind, { colour: name, symbol, title }]) =>
          h(
            'li',
            null,
            h('span', { class: 'swatch', 'aria-hidden': 'true', style: { background: `var(${name})` } }, symbol),
            `${title}: ${count(counts[kind] ?? 0)}`,
          ),
        ),
        h('li', null, '▼ event of the worker'),
      );
      setText(
        summary,
        `${plural(store.attempts.rows, 'attempt')} of ${plural(lanes.names().length, 'worker')}; ${count((counts.agreed ?? 0) + (counts.disagreed ?? 0))} audits, ${count(counts.disagreed ?? 0)} of them disagreed; ${count(counts.lost ?? 0)} lost.`,
      );
    }

    /** The individual that an attempt computed, as `generation.individual`, or null. */
    function individualOf(row) {
      if (store.individuals === null || columns().run_seconds[row] === null) return null;
      const of = store.individuals.columns;
      const [worker, seconds] = [columns().worker[row], columns().run_seconds[row]];
      const found = of.run_seconds.findIndex((value, at) => value === seconds && of.worker[at] === worker);
      return found < 0 ? null : `${of.generation[found]}.${of.individual[found]}`;
    }

    let factsKey = '';
    function drawFacts() {
      const row = selectedRow();
      const individual = row < 0 ? null : individualOf(row);
      const key = `${state.get('attempt')} ${row} ${individual}`;
      if (key === factsKey) return;
      factsKey = key;
      if (row < 0) {
        replace(facts, h('p', { class: 'muted' }, 'No job is chosen.'));
        return;
      }
      const of = (name) => columns()[name][row];
      const list = [
        ['Job', `${of('job')}, attempt ${of('attempt')}`],
        ['Worker', of('worker')],
        ['Task', of('task')],
        ['Handed out', moment(of('handed_out_ms'))],
        [
          'Ended',
          `${moment(of('ended_ms'))}, after ${duration((of('ended_ms') - of('handed_out_ms')) / 1000)}, of which it ran ${duration(of('run_seconds'))}`,
        ],
        ['End', `${of('end')}${of('reason') ? `: ${of('reason')}` : ''}`],
      ];
      replace(
        facts,
        h(
          'dl',
          { class: 'facts' },
          list.map(([name, text]) => [h('dt', null, name), h('dd', null, text)]),
        ),
        h(
          'p',
          { class: 'row' },
          h('button', { onclick: () => table.reveal(String(of('sequence'))) }, 'Its row in the table'),
          h('button', { onclick: () => context.navigate('log', { worker: of('worker') }) }, 'Events of the worker'),
          individual &&
            h(
              'button',
              { onclick: () => context.navigate('population', { selected: individual }) },
              `Individual ${individual}`,
            ),
        ),
      );
    }

    const cell = (name) => (row) => columns()[name][row];
    const table = createTable({
      caption: 'Attempts',
      key: (row) => columns().sequence[row],
      page: 25,
      sort: 'ended_ms:descending',
      getSort: () => state.get('sort'),
      setSort: (sort) => state.set({ sort }),
      rowClass: (row) => (String(columns().sequence[row]) === state.get('attempt') ? 'selected' : ''),
      empty: 'No attempt matches.',
      columns: [
        {
          id: 'job',
          title: 'Job',
          header: true,
          value: cell('job'),
          node: (row) =>
            h(
              'button',
              { class: 'small', 'aria-label': `show job ${cell('job')(row)}`, onclick: () => choose(row) },
              String(cell('job')(row)),
            ),
        },
        { id: 'attempt', title: 'Attempt', number: true, value: cell('attempt') },
        { id: 'worker', title: 'Worker', value: cell('worker') },
        {
          id: 'end',
          title: 'End',
          value: cell('end'),
          text: (row) => `${KINDS[kindOf(cell('end')(row))].symbol} ${cell('end')(row)}`.trim(),
        },
        {
          id: 'handed_out_ms',
          title: 'Handed out',
          value: cell('handed_out_ms'),
          text: (row) => moment(cell('handed_out_ms')(row)),
        },
        { id: 'ended_ms', title: 'Ended', value: cell('ended_ms'), text: (row) => moment(cell('ended_ms')(row)) },
        { id: 'run_seconds', title: 'Ran', number: true, value: cell('run_seconds') },
        { id: 'task', title: 'Task', value: cell('task') },
        { id: 'reason', title: 'Reason', value: cell('reason') },
      ],
    });
    replace(tablePlace, table.element);

    function drawTable() {
      const { rows } = store.attempts;
      const chosen = state.get('worker');
      const plain = show() === 'all' && passingJobs === null;
      const all = [];
      for (let row = 0; row < rows; row++) {
        if (chosen !== null && columns().worker[row] !== chosen) continue;
        if (plain || wanted(row)) all.push(row);
      }
      table.set(all);
    }

    function choose(row) {
      state.set({ attempt: columns().sequence[row], worker: columns().worker[row] });
      sight();
    }

    /** Scrolls the lane chosen, and its job, into sight. */
    function sight() {
      const at = names.indexOf(state.get('worker'));
      if (at < 0) return;
      const height = box.clientHeight;
      if (at * LANE < box.scrollTop) box.scrollTop = at * LANE;
      else if ((at + 1) * LANE > box.scrollTop + height) box.scrollTop = (at + 1) * LANE - height;
      const row = selectedRow();
      const [low, high] = domain();
      if (row >= 0 && (columns().ended_ms[row] < low || columns().handed_out_ms[row] > high)) {
        const half = (high - low) / 2;
        setDomain([columns().handed_out_ms[row] - half, columns().handed_out_ms[row] + half]);
      }
    }

    const position = (event) => {
      const bounds = canvas.getBoundingClientRect();
      return [event.clientX - bounds.left, event.clientY - bounds.top];
    };

    function pick(px, py) {
      const name = names[Math.floor((py + box.scrollTop) / LANE)];
      if (name === undefined) return;
      if (px < left()) {
        state.set({ worker: name });
        return;
      }
      const lane = lanes.of(name, columns());
      const slot = Math.floor(((((py + box.scrollTop) % LANE) - 2) / (LANE - 5)) * lane.height);
      let [best, distance] = [null, 8];
      lane.rows.forEach((row, at) => {
        const [from, to] = [x(columns().handed_out_ms[row]), x(columns().ended_ms[row])];
        const off = Math.max(0, from - px, px - to) + Math.abs(lane.slots[at] - slot) * 2;
        if (off < distance) [best, distance] = [row, off];
      });
      if (best !== null) choose(best);
    }

    box.addEventListener('pointerdown', (event) => {
      if (x === null || event.button !== 0 || event.target !== canvas) return;
      drag = position(event);
      if (event.pointerType !== 'touch') canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (drag === null || event.pointerType === 'touch') return;
      const [px] = position(event);
      drawLanes();
      const context2d = canvas.getContext('2d');
      context2d.globalAlpha = 0.2;
      context2d.fillStyle = colour('--accent');
      context2d.fillRect(Math.min(px, drag[0]), 0, Math.abs(px - drag[0]), canvas.height);
      context2d.globalAlpha = 1;
    });
    canvas.addEventListener('pointerup', (event) => {
      if (drag === null) return;
      const from = drag;
      drag = null;
      const [px, py] = position(event);
      if (Math.abs(px - from[0]) < 5) pick(px, py);
      else if (event.pointerType !== 'touch') {
        setDomain([from[0], px].map((at) => x.invert(Math.max(left(), at))).sort((a, b) => a - b));
      }
    });
    canvas.addEventListener('dblclick', () => setDomain(null));
    box.addEventListener('scroll', () => requestAnimationFrame(() => x !== null && drawLanes()));

    function step(by) {
      const worker = state.get('worker') ?? names[0];
      const lane = lanes.of(worker, columns());
      if (!lane) return;
      const now = lane.rows.indexOf(selectedRow());
      const next = now < 0 ? (by > 0 ? 0 : lane.rows.length - 1) : now + by;
      if (lane.rows[next] !== undefined) choose(lane.rows[next]);
    }

    box.addEventListener('keydown', (event) => {
      if (store.attempts === null || event.target !== box) return;
      const lane = names.indexOf(state.get('worker'));
      const move = (to) => {
        if (names[to] === undefined) return;
        state.set({ worker: names[to], attempt: null });
        sight();
      };
      const acts = {
        ArrowDown: () => move(lane + 1),
        ArrowUp: () => move(lane < 0 ? 0 : lane - 1),
        ArrowRight: () => step(1),
        ArrowLeft: () => step(-1),
        Enter: () => table.reveal(state.get('attempt') ?? ''),
        '+': () => zoom(0.5),
        '-': () => zoom(2),
        0: () => setDomain(null),
      };
      if (!acts[event.key]) return;
      event.preventDefault();
      acts[event.key]();
    });

    const stop = onWidth(place, (now) => {
      width = now;
      draw();
    });
    let placed = false;
    let tableAt = 0;

    return {
      update(changed) {
        if (store.attempts === null) {
          setText(summary, store.run === null ? 'Waiting for the run …' : 'No attempt has ended yet.');
          return;
        }
        if (!['attempts', 'events', 'filter', 'state', 'individuals'].some((name) => changed.has(name))) return;
        if (changed.has('attempts')) lanes.read(store.attempts);
        if (changed.has('filter') || (store.filtered() && changed.has('individuals'))) readPassing();
        listNames();
        drawTools();
        if (changed.has('attempts')) drawLegend();
        draw();
        drawFacts();
        const byReader = changed.has('state') || changed.has('filter');
        if (byReader || store.attempts.rows < MANY || performance.now() - tableAt > TABLE_PAUSE) {
          tableAt = performance.now();
          drawTable();
        }
        if (!placed && width > 0) {
          placed = true;
          sight();
        }
      },
      destroy() {
        stop();
      },
    };
  },
};
