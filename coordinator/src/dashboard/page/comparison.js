// Several runs beside each other: their convergence in one chart, with bands over seeds, and a table of differences.

import { createChart } from './chart.js';
import { AXES, bandOf, bestCurve, createCurves, curve, groupOf } from './curves.js';
import { choice, h, replace } from './dom.js';
import { count, duration, percent, points } from './format.js';
import { createTable } from './table.js';
import { createWinners } from './winners.js';

const STYLES = [
  { colour: '--c1', dash: '', symbol: 'circle' },
  { colour: '--c2', dash: '7 3', symbol: 'square' },
  { colour: '--c3', dash: '2 3', symbol: 'triangle' },
  { colour: '--c4', dash: '9 3 2 3', symbol: 'diamond' },
  { colour: '--c5', dash: '', symbol: 'square' },
  { colour: '--c6', dash: '5 5', symbol: 'circle' },
  { colour: '--c7', dash: '2 5', symbol: 'diamond' },
];
const MEASURES = {
  best: 'best so far, training',
  mean: 'mean, training',
  validation: 'best of the generation, validation',
};
const ONE_MINUS = (fitness) => 1 - fitness;

function measure(columns, axis, of) {
  if (of === 'mean') return curve(columns, axis, 'mean_fitness', ONE_MINUS);
  if (of === 'validation') return curve(columns, axis, 'validation_object_error').filter(([, y]) => y !== null);
  return bestCurve(columns, axis);
}

/** The ids in the address under `compare`. */
export function comparedIds(state) {
  return (state.get('compare') ?? '').split(',').filter(Boolean).map(decodeURIComponent);
}

/** Puts ids into the address. */
export function setCompared(state, ids) {
  state.set({ compare: ids.length === 0 ? null : ids.map(encodeURIComponent).join(',') });
}

/** What numbers look like along an axis. */
export const axisFormat = (axis) => (axis === 'time' ? duration : count);

/** The least distance of ticks along an axis: there is no half generation. */
export const axisLeast = (axis) => (axis === 'time' ? 0 : 1);

/** The domain in the address, or undefined. */
export function zoomOf(state) {
  const ends = (state.get('zoom') ?? '').split('..').map(Number);
  return ends.length === 2 && ends.every(Number.isFinite) && ends[1] > ends[0] ? ends : undefined;
}

/** Puts a domain, or null, into the address. */
export function setZoom(state, domain) {
  state.set({ zoom: domain === null ? null : domain.map((end) => Number(end.toPrecision(5))).join('..') });
}

/** Buttons for what lies along x. */
export function axisChoice(state) {
  return choice('Along x', Object.entries(AXES), state.get('x') ?? 'generations', (x) => state.set({ x, zoom: null }));
}

const difference = (run, first, name) =>
  run[name] === null || first[name] === null || run === first ? null : run[name] - first[name];

function differenceTable(first) {
  const errors = [
    ['best_error', 'Training'],
    ['validation_error', 'Validation'],
    ['test_error', 'Test'],
  ];
  const columns = [
    {
      id: 'id',
      title: 'Run',
      header: true,
      value: (run) => run.id,
      text: (run) => (run.id === first().id ? `${run.id} (reference)` : run.id),
    },
    { id: 'seed', title: 'Seed', number: true, value: (run) => run.seed },
  ];
  for (const [name, title] of errors) {
    columns.push(
      { id: name, title: `${title} error`, number: true, value: (run) => run[name], text: (run) => percent(run[name]) },
      {
        id: `${name}_difference`,
        title: 'Δ points',
        hint: `${title} error minus that of the reference`,
        number: true,
        value: (run) => difference(run, first(), name),
        text: (run) => (run.id === first().id ? '' : points(difference(run, first(), name))),
      },
    );
  }
  columns.push(
    { id: 'regret', title: 'Regret', number: true, value: (run) => run.regret, text: (run) => percent(run.regret) },
    {
      id: 'generation',
      title: 'Generations',
      number: true,
      value: (run) => run.generation,
      text: (run) => count(run.generation),
    },
    {
      id: 'evaluations',
      title: 'Evaluations',
      number: true,
      value: (run) => run.evaluations_computed,
      text: (run) => count(run.evaluations_computed),
    },
    { id: 'seconds', title: 'Time', number: true, value: (run) => run.seconds, text: (run) => duration(run.seconds) },
  );
  return createTable({
    caption: 'Differences of the selected runs',
    columns,
    key: (run) => run.id,
    sort: 'id:ascending',
  });
}

/**
 * @param {HTMLElement} root
 * @param {object} context of the page
 * @returns {{show: function(object[]): void, draw: function(): void, destroy: function(): void}} `show` takes runs
 */
export function createComparison(root, context) {
  const { state } = context;
  const tools = h('div', { class: 'row' });
  const note = h('p', { class: 'muted', role: 'status' });
  const place = h('div', null);
  const chart = createChart(place, { height: 340, onzoom: (domain) => setZoom(state, domain) });
  let runs = [];
  const table = differenceTable(() => runs[0]);
  const winnersPlace = h('div', null, h('h3', null, 'Winners'));
  root.append(tools, note, place, h('h3', null, 'Differences'), table.element, winnersPlace);
  const winners = createWinners(winnersPlace, context.api);
  const curves = createCurves(context.api, () => schedule());
  let timer = 0;

  function schedule() {
    if (timer === 0) timer = setTimeout(draw, 200);
  }

  function grouped() {
    const groups = new Map();
    for (const run of runs) {
      const key = state.get('bands') === 'off' ? run.id : groupOf(run);
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(run);
    }
    return groups;
  }

  function draw() {
    timer = 0;
    const axis = state.get('x') ?? 'generations';
    const of = state.get('measure') ?? 'best';
    replace(
      tools,
      axisChoice(state),
      choice('Error', Object.entries(MEASURES), of, (value) => state.set({ measure: value })),
      choice(
        'Seeds',
        [
          ['on', 'as bands'],
          ['off', 'as single lines'],
        ],
        state.get('bands') ?? 'on',
        (bands) => state.set({ bands }),
      ),
    );
    const spec = { series: [], bands: [], lines: [] };
    const absent = runs.filter(({ id, generation }) => generation > 0 && curves.of(id) === null);
    const failed = absent.find(({ id }) => curves.problem(id));
    note.textContent = failed
      ? `${failed.id}: ${curves.problem(failed.id)}`
      : absent.length > 0
        ? `Fetching ${absent.length} of ${runs.length} runs …`
        : '';
    let index = 0;
    for (const [name, members] of grouped()) {
      const style = STYLES[index++ % STYLES.length];
      const present = members
        .map(({ id }) => curves.of(id))
        .filter(Boolean)
        .map((columns) => measure(columns, axis, of))
        .filter((line) => line.length > 0);
      if (present.length === 0) continue;
      if (present.length === 1) {
        spec.series.push({ name: members.length === 1 ? members[0].id : name, ...style, points: present[0] });
        continue;
      }
      const { middle, band } = bandOf(present);
      spec.series.push({ name: `${name}: median of ${present.length} seeds`, ...style, points: middle });
      spec.bands.push({ name: `${name}: least to highest`, colour: style.colour, points: band });
    }
    const optima = [...new Set(runs.map((run) => run.optimum_error).filter((value) => value !== null))];
    for (const y of optima) spec.lines.push({ name: 'known optimum', y, colour: '--good', dash: '2 3' });
    chart.draw({
      ...spec,
      label: `Convergence of ${runs.length} runs: ${runs.map((run) => `${run.id} ${percent(run.best_error)}`).join(', ')}.`,
      x: { title: AXES[axis], format: axisFormat(axis), least: axisLeast(axis), domain: zoomOf(state) },
      y: { title: `Error: ${MEASURES[of]}`, format: (value) => percent(value, 1) },
    });
    table.set(runs);
  }

  return {
    show(next) {
      runs = next;
      runs.forEach((run) => curves.want(run));
      winners.show(runs);
      draw();
    },
    draw,
    destroy() {
      clearTimeout(timer);
      curves.close();
      winners.close();
      chart.destroy();
    },
  };
}
