// Who did what when: a lane for each worker with its jobs, audits and losses, and the attempts as a table.

import { passingWorkers } from './brush.js';
import { choice, h, replace, setText } from './dom.js';
import { count, duration, moment, plural } from './format.js';
import { KINDS, createLanes, kindOf } from './lanes.js';
import { createTable } from './table.js';
import { createTimelineCanvas } from './timeline-canvas.js';

/** Between two drawings of the lanes by the stream; what the reader does is shown at once. */
const LANES_PAUSE = 2000;
/** Above so many attempts, the table follows the stream more slowly than the lanes. */
const MANY = 1_000;
const TABLE_PAUSE = 5000;
const AUDITS = new Set(['agreed', 'disagreed']);
const LOSSES = new Set(['lost', 'failed', 'late', 'disagreed']);
const CHOICES = [
  ['all', 'all'],
  ['audits', 'audits'],
  ['losses', 'losses and disagreements'],
];

/** The jobs of individuals that pass the brush, by worker and time on it, which both tables have; null without one. */
function passingJobs(store) {
  if (!store.filtered() || store.individuals === null) return null;
  const jobs = new Set();
  const { columns, rows } = store.individuals;
  for (let row = 0; row < rows; row++) {
    if (columns.worker[row] !== null && store.passes(row))
      jobs.add(`${columns.worker[row]} ${columns.run_seconds[row]}`);
  }
  return jobs;
}

/** The individual that an attempt computed, as `generation.individual`, or null. */
function individualOf(store, row) {
  const { worker, run_seconds: ran } = store.attempts.columns;
  if (store.individuals === null || ran[row] === null) return null;
  const { columns } = store.individuals;
  const found = columns.run_seconds.findIndex((value, at) => value === ran[row] && columns.worker[at] === worker[row]);
  return found < 0 ? null : `${columns.generation[found]}.${columns.individual[found]}`;
}

/** The table of attempts; `choose` takes a row. */
function attemptsTable(store, state, choose) {
  const cell = (name) => (row) => store.attempts.columns[name][row];
  const ends = (row) => `${KINDS[kindOf(cell('end')(row))].symbol} ${cell('end')(row)}`.trim();
  const jobButton = (row) =>
    h(
      'button',
      { class: 'small', 'aria-label': `show job ${cell('job')(row)}`, onclick: () => choose(row) },
      String(cell('job')(row)),
    );
  const time = (id, title) => ({ id, title, value: cell(id), text: (row) => moment(cell(id)(row)) });
  return createTable({
    caption: 'Attempts',
    key: cell('sequence'),
    page: 25,
    sort: 'ended_ms:descending',
    getSort: () => state.get('sort'),
    setSort: (sort) => state.set({ sort }),
    rowClass: (row) => (String(cell('sequence')(row)) === state.get('attempt') ? 'selected' : ''),
    empty: 'No attempt matches.',
    columns: [
      { id: 'job', title: 'Job', header: true, value: cell('job'), node: jobButton },
      { id: 'attempt', title: 'Attempt', number: true, value: cell('attempt') },
      { id: 'worker', title: 'Worker', value: cell('worker') },
      { id: 'end', title: 'End', value: cell('end'), text: ends },
      time('handed_out_ms', 'Handed out'),
      time('ended_ms', 'Ended'),
      { id: 'run_seconds', title: 'Ran', number: true, value: cell('run_seconds') },
      { id: 'task', title: 'Task', value: cell('task') },
      { id: 'reason', title: 'Reason', value: cell('reason') },
    ],
  });
}

function legendEntries(counts) {
  const entry = ([kind, { colour, symbol, title }]) => {
    const swatch = { class: 'swatch', 'aria-hidden': 'true', style: { background: `var(${colour})` } };
    return h('li', null, h('span', swatch, symbol), `${title}: ${count(counts[kind] ?? 0)}`);
  };
  return [...Object.entries(KINDS).map(entry), h('li', null, '▼ event of the worker')];
}

export const view = {
  id: 'timeline',
  title: 'Timeline',
  create(root, context) {
    const { store, state } = context;
    const lanes = createLanes();
    const summary = h('p', { class: 'muted', role: 'status' });
    const tools = h('div', { class: 'row' });
    const place = h('div', null);
    const legend = h('ul', { class: 'legend' });
    const hint = 'Drag to zoom in time, click a job for its row. Pale: in hand; solid: computing.';
    const facts = h('div', { 'aria-live': 'polite' });
    const table = attemptsTable(store, state, (row) => choose(row));
    const section = (title, ...children) => h('section', { class: 'panel' }, h('h2', null, title), ...children);
    replace(
      root,
      section('Timeline', summary, tools, place, legend, h('p', { class: 'muted' }, hint)),
      section('Job', facts),
      section('Attempts', table.element),
    );
    const canvas = createTimelineCanvas(place, {
      zoom: setDomain,
      job: (row) => choose(row),
      lane: (worker) => state.set({ worker }),
      key: (key) => key in keys && (keys[key](), true),
    });
    let names = [];
    let passing = null;
    let jobs = null;
    let placed = false;
    let tableAt = 0;
    let lanesAt = 0;
    let timer = 0;
    let omitted = 0;
    let isStale = false;
    let isFiltered = false;
    let toolsKey = '';
    let factsKey = '';

    const columns = () => store.attempts.columns;
    const show = () => state.get('show') ?? 'all';
    const selectedRow = () => {
      const wanted = Number(state.get('attempt') ?? NaN);
      return Number.isNaN(wanted) ? -1 : columns().sequence.indexOf(wanted);
    };

    function domain() {
      const ends = (state.get('t') ?? '').split('..').map(Number);
      if (ends.length === 2 && ends[1] > ends[0]) return ends;
      const [low, high] = lanes.span();
      return high > low ? [low, high + (high - low) * 0.01] : [low - 500, low + 500];
    }

    function setDomain(ends) {
      state.set({ t: ends === null ? null : ends.map(Math.round).join('..') });
    }

    function zoom(factor) {
      const [low, high] = domain();
      const row = selectedRow();
      const middle = row >= 0 ? columns().handed_out_ms[row] : (low + high) / 2;
      setDomain([middle - (middle - low) * factor, middle + (high - middle) * factor]);
    }

    function wanted(row) {
      const kind = kindOf(columns().end[row]);
      if (show() === 'audits' && !AUDITS.has(kind)) return false;
      if (show() === 'losses' && !LOSSES.has(kind)) return false;
      return jobs === null || jobs.has(`${columns().worker[row]} ${columns().run_seconds[row]}`);
    }

    function listNames() {
      const word = (state.get('wfind') ?? '').toLowerCase();
      const chosen = state.get('worker');
      const shown = (name) => passing === null || passing.has(name) || name === chosen;
      names = lanes.names().filter((name) => name.toLowerCase().includes(word) && shown(name));
    }

    function draw() {
      canvas.draw({
        table: store.attempts,
        names,
        lane: (name) => lanes.of(name, columns()),
        domain: domain(),
        span: lanes.span(),
        events: store.events ?? [],
        worker: state.get('worker'),
        selected: selectedRow(),
        bright: wanted,
      });
    }

    function drawTools() {
      const key = JSON.stringify([show(), state.get('worker')]);
      if (key === toolsKey) return;
      toolsKey = key;
      const find = (event) => state.set({ wfind: event.target.value });
      const search = h('input', { type: 'search', value: state.get('wfind') ?? '', oninput: find });
      const button = (text, label, act) => h('button', { 'aria-label': label, title: label, onclick: act }, text);
      const worker = state.get('worker');
      replace(
        tools,
        h('label', { class: 'field' }, 'Workers', search),
        choice('Jobs', CHOICES, show(), (value) => state.set({ show: value === 'all' ? null : value })),
        button('+', 'Zoom in', () => zoom(0.5)),
        button('−', 'Zoom out', () => zoom(2)),
        button('Whole', 'Show the whole time', () => setDomain(null)),
        worker && button(`Lane of ${worker} ✕`, `Lane of ${worker}: choose none`, () => state.set({ worker: null })),
      );
    }

    function drawLegend() {
      const counts = lanes.counts();
      replace(legend, legendEntries(counts));
      const audits = (counts.agreed ?? 0) + (counts.disagreed ?? 0);
      const parts = [
        `${plural(store.attempts.rows, 'attempt')} of ${plural(lanes.names().length, 'worker')}`,
        `${plural(audits, 'audit')}, ${count(counts.disagreed ?? 0)} disagreed`,
        `${count(counts.lost ?? 0)} lost`,
      ];
      setText(summary, `${parts.join('; ')}.`);
    }

    function drawFacts() {
      const row = selectedRow();
      const individual = row < 0 ? null : individualOf(store, row);
      const key = `${state.get('attempt')} ${row} ${individual}`;
      if (key === factsKey) return;
      factsKey = key;
      if (row < 0) {
        replace(facts, h('p', { class: 'muted' }, 'No job is chosen.'));
        return;
      }
      const of = (name) => columns()[name][row];
      const took = duration((of('ended_ms') - of('handed_out_ms')) / 1000);
      const list = [
        ['Job', `${of('job')}, attempt ${of('attempt')}`],
        ['Worker', of('worker')],
        ['Task', of('task')],
        ['Handed out', moment(of('handed_out_ms'))],
        ['Ended', `${moment(of('ended_ms'))}, after ${took}, of which it ran ${duration(of('run_seconds'))}`],
        ['End', `${of('end')}${of('reason') ? `: ${of('reason')}` : ''}`],
      ];
      const button = (text, onclick) => h('button', { onclick }, text);
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
          button('Its row in the table', () => table.reveal(String(of('sequence')))),
          button('Events of the worker', () => context.navigate('log', { worker: of('worker') })),
          individual &&
            button(`Individual ${individual}`, () => context.navigate('population', { selected: individual })),
        ),
      );
    }

    function drawTable() {
      const chosen = state.get('worker');
      const plain = show() === 'all' && jobs === null;
      const rows = [];
      for (let row = 0; row < store.attempts.rows; row++) {
        if (chosen !== null && columns().worker[row] !== chosen) continue;
        if (plain || wanted(row)) rows.push(row);
      }
      table.set(rows);
    }

    function choose(row) {
      state.set({ attempt: columns().sequence[row], worker: columns().worker[row] });
      sight();
    }

    /** Puts the lane chosen, and its job, into sight. */
    function sight() {
      canvas.sight(state.get('worker'));
      const row = selectedRow();
      const [low, high] = domain();
      if (row < 0 || (columns().ended_ms[row] >= low && columns().handed_out_ms[row] <= high)) return;
      const half = (high - low) / 2;
      setDomain([columns().handed_out_ms[row] - half, columns().handed_out_ms[row] + half]);
    }

    function stepJob(by) {
      const lane = lanes.of(state.get('worker') ?? names[0], columns());
      if (!lane) return;
      const now = lane.rows.indexOf(selectedRow());
      const next = now < 0 ? (by > 0 ? 0 : lane.rows.length - 1) : now + by;
      if (lane.rows[next] !== undefined) choose(lane.rows[next]);
    }

    function stepLane(by) {
      const worker = names[Math.max(0, names.indexOf(state.get('worker')) + by)];
      if (worker === undefined) return;
      state.set({ worker, attempt: null });
      sight();
    }

    const keys = {
      ArrowDown: () => stepLane(1),
      ArrowUp: () => stepLane(-1),
      ArrowRight: () => stepJob(1),
      ArrowLeft: () => stepJob(-1),
      Enter: () => table.reveal(state.get('attempt') ?? ''),
      '+': () => zoom(0.5),
      '-': () => zoom(2),
      0: () => setDomain(null),
    };

    /** Draws what has come since, and what the reader has changed. */
    function follow(byReader) {
      if (store.attempts === null) return;
      lanesAt = performance.now();
      if (isStale) lanes.read(store.attempts);
      if (isFiltered) {
        passing = passingWorkers(store);
        jobs = passingJobs(store);
      }
      listNames();
      drawTools();
      if (isStale) drawLegend();
      [isStale, isFiltered] = [false, false];
      draw();
      drawFacts();
      if (byReader || store.attempts.rows < MANY || performance.now() - tableAt > TABLE_PAUSE) {
        tableAt = performance.now();
        drawTable();
      }
      if (!placed) {
        placed = true;
        sight();
      }
    }

    return {
      update(changed) {
        if (store.attempts === null) {
          setText(summary, store.run === null ? 'Waiting for the run …' : 'No attempt has ended yet.');
          return;
        }
        const follows = ['attempts', 'events', 'filter', 'state'];
        if (store.filtered() || state.get('attempt') !== null) follows.push('individuals');
        if (!follows.some((name) => changed.has(name))) return;
        const byReader = changed.has('state') || changed.has('filter');
        isStale ||= changed.has('attempts');
        isFiltered ||= changed.has('filter') || (store.filtered() && changed.has('individuals'));
        clearTimeout(timer);
        // Rows have other places as soon as the oldest are dropped.
        const isMoved = omitted !== (store.attempts.omitted ?? 0);
        omitted = store.attempts.omitted ?? 0;
        const wait = byReader || isMoved ? 0 : Math.max(0, lanesAt + LANES_PAUSE - performance.now());
        if (wait > 0) timer = setTimeout(() => follow(false), wait);
        else follow(byReader);
      },
      destroy() {
        clearTimeout(timer);
        canvas.destroy();
      },
    };
  },
};
