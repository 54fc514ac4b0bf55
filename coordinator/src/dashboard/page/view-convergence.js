// How the run converges: best, mean and validation error, diversity, and other runs of its sweep beside it.

import { createChart } from './chart.js';
import {
  axisChoice,
  axisFormat,
  axisLeast,
  comparedIds,
  createComparison,
  setCompared,
  setZoom,
  zoomOf,
} from './comparison.js';
import { AXES, bestCurve, curve, positions } from './curves.js';
import { h, replace } from './dom.js';
import { number, percent } from './format.js';

const ONE_MINUS = (fitness) => 1 - fitness;

/** The least error of the individuals that pass the brush, by generation. */
function brushed(store, columns, axis) {
  const least = new Map();
  const { rows, columns: of } = store.individuals;
  for (let row = 0; row < rows; row++) {
    if (!store.passes(row)) continue;
    const error = of.object_error[row];
    const generation = of.generation[row];
    if (error !== null && error < (least.get(generation) ?? Infinity)) least.set(generation, error);
  }
  const xs = positions(columns, axis);
  return columns.generation
    .map((generation, row) => [xs[row], least.get(generation) ?? null])
    .filter(([, y]) => y !== null);
}

/** Compared descriptors as level lines. They are errors on test clouds, and the names say so. */
function comparedLines(detail) {
  if (!detail?.compared) return [];
  const { rows, columns } = detail.compared;
  const dashes = ['8 4', '3 3', '8 3 2 3', '1 4', '12 4'];
  return Array.from({ length: rows }, (_, row) => ({
    name: `${columns.descriptor[row]}, test`,
    y: columns.object_error[row],
    colour: columns.descriptor[row] === 'evolved' ? '--c1' : '--muted',
    dash: dashes[row % dashes.length],
  }));
}

export const view = {
  id: 'convergence',
  title: 'Convergence',
  create(root, context) {
    const { store, state } = context;
    const tools = h('div', { class: 'row' });
    const place = h('section', { class: 'panel' }, h('h2', null, 'Error'), tools);
    const second = h('section', { class: 'panel' }, h('h2', null, 'Diversity'));
    const others = h('section', { class: 'panel' });
    const list = h('fieldset', { class: 'siblings' });
    const box = h('div', null);
    replace(root, place, second, others);
    others.append(h('h2', null, 'With other runs'), list, box);
    const onzoom = (domain) => setZoom(state, domain);
    const chart = createChart(place, { height: 400, onzoom });
    const small = createChart(second, { height: 190, onzoom });
    let comparison = null;
    let drawnList = '';
    let drawnOptimum = null;

    function drawTools() {
      const toggle = h('input', {
        type: 'checkbox',
        checked: state.get('lines') !== 'off',
        onchange: (event) => state.set({ lines: event.target.checked ? null : 'off' }),
      });
      if (tools.contains(document.activeElement)) return;
      replace(tools, axisChoice(state), h('label', { class: 'field inline' }, toggle, 'Compared descriptors'));
    }

    function drawErrors(columns, axis) {
      const series = [
        { name: 'best so far', colour: '--c1', points: bestCurve(columns, axis) },
        {
          name: 'best of the generation',
          colour: '--c1',
          thin: true,
          dash: '2 3',
          points: curve(columns, axis, 'best_fitness', ONE_MINUS),
        },
        { name: 'mean', colour: '--c2', dash: '7 3', points: curve(columns, axis, 'mean_fitness', ONE_MINUS) },
      ];
      const validation = curve(columns, axis, 'validation_object_error');
      if (validation.some(([, y]) => y !== null)) {
        series.push({ name: 'validation', colour: '--c3', dash: '1 4', symbol: 'triangle', points: validation });
      }
      if (store.filtered() && store.individuals !== null) {
        series.push({
          name: 'best of the brushed',
          colour: '--c5',
          symbol: 'diamond',
          only: true,
          points: brushed(store, columns, axis),
        });
      }
      const winner = store.detail?.winner;
      const at = winner ? columns.generation.indexOf(winner.generation) : -1;
      if (at >= 0) {
        series.push({
          name: 'winner',
          colour: '--text',
          symbol: 'square',
          only: true,
          points: [[positions(columns, axis)[at], 1 - columns.best_fitness[at]]],
        });
      }
      const lines = state.get('lines') === 'off' ? [] : comparedLines(store.detail);
      const optimum = store.run?.optimum_error;
      if (optimum !== null && optimum !== undefined)
        lines.push({ name: 'known optimum, training', y: optimum, colour: '--good', dash: '2 3' });
      const last = columns.generation.length - 1;
      chart.draw({
        label: `Error by ${AXES[axis].toLowerCase()}: best so far ${percent(1 - columns.best_so_far_fitness[last])} after generation ${columns.generation[last]}, mean ${percent(1 - columns.mean_fitness[last])}, validation ${percent(columns.validation_object_error?.[last])}.`,
        x: { title: AXES[axis], format: axisFormat(axis), least: axisLeast(axis), domain: zoomOf(state) },
        y: { title: 'Error', format: (value) => percent(value, 1) },
        series,
        bands: [
          {
            name: 'best to worst of the generation',
            colour: '--c6',
            points: positions(columns, axis).map((x, row) => [
              x,
              1 - columns.best_fitness[row],
              1 - columns.worst_fitness[row],
            ]),
          },
        ],
        lines,
      });
    }

    function drawDiversity(columns, axis) {
      const series = [
        { name: 'diversity', colour: '--c4', points: curve(columns, axis, 'diversity') },
        { name: 'mutation rate', colour: '--c7', dash: '7 3', points: curve(columns, axis, 'mutation_rate') },
      ];
      const volume = curve(columns, axis, 'hypervolume');
      if (volume.some(([, y]) => y !== null))
        series.push({ name: 'hypervolume of the front', colour: '--c3', dash: '2 3', points: volume });
      const last = columns.generation.length - 1;
      small.draw({
        label: `Diversity ${percent(columns.diversity[last])} per bit, mutation rate ${number(columns.mutation_rate[last])} in generation ${columns.generation[last]}.`,
        x: { title: AXES[axis], format: axisFormat(axis), least: axisLeast(axis), domain: zoomOf(state) },
        y: { title: 'Share', format: (value) => percent(value, 0), zero: true },
        series,
        bands: [],
        lines: [],
      });
    }

    function siblings() {
      const runs = (context.runs?.runs ?? []).filter((run) => run.kind === 'run' && run.id !== store.run?.id);
      const sweep = store.run?.sweep;
      const [near, far] = [[], []];
      for (const run of runs) (sweep && run.sweep === sweep ? near : far).push(run);
      return [...near, ...far.filter((run) => run.name === store.run?.name)];
    }

    function drawList() {
      const runs = siblings();
      const ids = comparedIds(state);
      const key = JSON.stringify([runs.map(({ id }) => id), ids]);
      others.hidden = runs.length === 0;
      if (key === drawnList) return;
      drawnList = key;
      const toggle = (id) => (event) => {
        const rest = comparedIds(state).filter((other) => other !== id);
        setCompared(state, event.target.checked ? [...rest, id] : rest);
      };
      replace(
        list,
        h('legend', null, 'Runs of the same sweep, and of the same name'),
        h(
          'button',
          {
            class: 'small',
            onclick: () =>
              setCompared(
                state,
                runs.slice(0, 40).map(({ id }) => id),
              ),
          },
          'All',
        ),
        h('button', { class: 'small', onclick: () => setCompared(state, []) }, 'None'),
        runs
          .slice(0, 200)
          .map((run) =>
            h(
              'label',
              { class: 'inline' },
              h('input', { type: 'checkbox', checked: ids.includes(run.id), onchange: toggle(run.id) }),
              run.id,
            ),
          ),
      );
    }

    function drawComparison() {
      const runs = context.runs?.runs ?? [];
      const selected = comparedIds(state)
        .map((id) => runs.find((run) => run.id === id))
        .filter((run) => run && run.id !== store.run?.id);
      if (selected.length === 0 || store.run === null) {
        comparison?.destroy();
        comparison = null;
        replace(box);
        return;
      }
      comparison ??= createComparison(box, context);
      comparison.show([store.run, ...selected]);
    }

    return {
      update(changed) {
        const has = (names) => names.some((name) => changed.has(name));
        if (has(['state'])) drawTools();
        const columns = store.generations?.columns;
        const axis = state.get('x') ?? 'generations';
        const optimum = store.run?.optimum_error ?? null;
        // Not with each attempt that ends: drawing both charts again is what this view costs.
        const follows = ['generations', 'detail', 'filter', 'state', ...(store.filtered() ? ['individuals'] : [])];
        if (columns?.generation?.length > 0 && (has(follows) || optimum !== drawnOptimum)) {
          drawnOptimum = optimum;
          drawErrors(columns, axis);
          drawDiversity(columns, axis);
        }
        if (has(['run', 'runs', 'state'])) {
          drawList();
          drawComparison();
        }
      },
      destroy() {
        comparison?.destroy();
        chart.destroy();
        small.destroy();
      },
    };
  },
};
