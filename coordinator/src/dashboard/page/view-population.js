// The individuals: parallel coordinates, a scatter over the landscape, the front; brushing, and lineages.

import { extent } from './axes.js';
import { parseBrush, printBrush } from './brush.js';
import { createChart } from './chart.js';
import { choice, h, replace, setText } from './dom.js';
import { cell, count, number, percent, plural } from './format.js';
import { createLineage } from './lineage.js';
import { createParallel } from './parallel.js';
import { rampLegend } from './ramp.js';
import { createScatter, prepareLandscape } from './scatter.js';
import { createTable, plainTable } from './table.js';

const MOST_DRAWN = 20_000;
const MOST_AT_FIRST = 6_000;
const AXES_AT_FIRST = 10;
const MEASURES = ['object_error', 'category_error', 'cost', 'size', 'margin'];
const FRONT = [
  ['point', 'Point'],
  ['generation', 'Generation'],
  ['individual', 'Individual'],
  ['train_object_error', 'Training error'],
  ['validation_object_error', 'Validation error'],
  ['cost', 'Cost (≈ ns)'],
  ['size', 'Values a cloud'],
  ['winner', 'Winner'],
];

/** Columns that hold at least two different numbers in some rows, in order. */
function varying(table, names, rows) {
  return names.filter((name) => {
    let seen = null;
    for (const row of rows) {
      const value = table[name]?.[row];
      if (typeof value !== 'number') continue;
      if (seen !== null && value !== seen) return true;
      seen ??= value;
    }
    return false;
  });
}

const filled = (table, name, rows) => rows.reduce((sum, row) => sum + (typeof table[name][row] === 'number'), 0);

export const view = {
  id: 'population',
  title: 'Population',
  create(root, context) {
    const { store, state } = context;
    const select = (row) => {
      const { generation, individual } = store.individuals.columns;
      state.set({ selected: `${generation[row]}.${individual[row]}` });
      lineagePanel.scrollIntoView({ block: 'nearest' });
    };
    const setRange = (name, range) => {
      const ranges = parseBrush(state.get('brush'));
      if (range === null) ranges.delete(name);
      else ranges.set(name, range);
      state.set({ brush: printBrush(ranges) });
    };

    const section = (title, ...children) => h('section', { class: 'panel' }, h('h2', null, title), ...children);
    const scopeTools = h('div', { class: 'row' });
    const note = h('p', { class: 'muted', role: 'status' });
    const axesBox = h('details', null, h('summary', null, 'Axes'));
    const legend = h('div', null);
    const rangeBox = h('div', { class: 'ranges' });
    const rangeDetails = h(
      'details',
      { open: state.get('brush') !== null },
      h('summary', null, 'Ranges by numbers'),
      rangeBox,
    );
    const parallelPlace = h('div', null);
    const scatterTools = h('div', { class: 'row' });
    const scatterPlace = h('div', null);
    const landscapeNote = h('p', { class: 'muted', role: 'status' });
    const lineagePlace = h('div', null);
    const lineageNote = h(
      'p',
      { class: 'muted' },
      'Click an individual, or choose one in the table, to see where it comes from.',
    );
    const descriptorButton = h('button', { onclick: () => context.navigate('descriptor') }, 'What it looks at');
    const lineagePanel = section('Lineage', lineageNote, descriptorButton, lineagePlace);
    const frontPlace = h('div', null);
    const frontPanel = h('section', { class: 'panel', hidden: true }, h('h2', null, 'Front'), frontPlace);
    const tablePlace = h('div', null);
    replace(
      root,
      section(
        'Parallel coordinates',
        scopeTools,
        note,
        parallelPlace,
        legend,
        h(
          'p',
          { class: 'muted' },
          'Drag along an axis to brush it, click a brushed axis to clear it, click a line for its lineage.',
        ),
        axesBox,
        rangeDetails,
      ),
      h(
        'div',
        { class: 'grid two' },
        section('Scatter', scatterTools, scatterPlace, landscapeNote),
        frontPanel,
        lineagePanel,
      ),
      section('Individuals', tablePlace),
    );
    const parallel = createParallel(parallelPlace, { onbrush: setRange, onselect: select });
    const scatter = createScatter(scatterPlace, {
      onselect: select,
      onbrush: ({ x, y }) => {
        const ranges = parseBrush(state.get('brush'));
        ranges.set(axis('sx'), x);
        ranges.set(axis('sy'), y);
        state.set({ brush: printBrush(ranges) });
      },
    });
    const lineage = createLineage(lineagePlace, context, select);
    let frontChart = null;
    let table = null;
    let tableColumns = '';
    let landscape = { key: null, value: null };
    let toolsKey = '';

    const genes = () =>
      store.detail?.genes.map(({ name }) => name).filter((name) => store.individuals.columns[name]) ?? [];
    const unit = (name) => {
      const found = store.detail?.genes.find((gene) => gene.name === name)?.unit;
      return found ? `${name} (${found})` : name.replace(/_/g, ' ');
    };
    const measures = () => MEASURES.filter((name) => store.individuals.columns[name]?.some((value) => value !== null));
    const lastGeneration = () => store.individuals.columns.generation[store.individuals.rows - 1];
    const scope = () => state.get('scope') ?? (store.individuals.rows > MOST_AT_FIRST ? 'last' : 'all');
    const colourBy = () => (state.get('colour') === 'generation' ? 'generation' : 'object_error');

    function scopeRows() {
      const { rows, columns } = store.individuals;
      const wanted = scope();
      const rowsOf = (test) => {
        const found = [];
        for (let row = 0; row < rows; row++) if (test(columns.generation[row])) found.push(row);
        return found;
      };
      if (wanted === 'all') return Array.from({ length: rows }, (_, row) => row);
      const generation = wanted === 'last' ? lastGeneration() : Number(wanted);
      return rowsOf((value) => value === generation);
    }

    /** The genes on axes: those chosen, or the most informative ones. */
    function shownGenes(rows) {
      const chosen = state
        .get('axes')
        ?.split(',')
        .filter((name) => genes().includes(name));
      if (chosen?.length) return chosen;
      const { columns } = store.individuals;
      const candidates = varying(columns, genes(), rows);
      if (candidates.length <= AXES_AT_FIRST) return candidates;
      const order = new Map(candidates.map((name) => [name, filled(columns, name, rows)]));
      const best = new Set([...candidates].sort((a, b) => order.get(b) - order.get(a)).slice(0, AXES_AT_FIRST));
      return candidates.filter((name) => best.has(name));
    }

    /** The column along one axis of the scatter. */
    function axis(key) {
      const chosen = state.get(key);
      if (chosen && store.individuals.columns[chosen]) return chosen;
      const [first, second] = shownGenes(scopeRows());
      return key === 'sx' ? (first ?? 'generation') : landscapeKnown() && second ? second : 'object_error';
    }

    const landscapeKnown = () => store.run?.optimum_error !== null && store.run?.optimum_error !== undefined;

    function drawTools(rows, shown) {
      const generations = [...new Set(store.individuals.columns.generation)].sort((a, b) => b - a);
      const key = JSON.stringify([
        generations.length,
        state.get('scope'),
        scope(),
        state.get('colour'),
        axis('sx'),
        axis('sy'),
        shown,
        genes().length,
      ]);
      if (key === toolsKey) return;
      toolsKey = key;
      const scopes = [
        ['all', 'all loaded'],
        ['last', 'the last generation'],
        ...generations.slice(0, 500).map((value) => [String(value), `generation ${value}`]),
      ];
      replace(
        scopeTools,
        choice('Individuals of', scopes, scope(), (value) => state.set({ scope: value })),
        choice(
          'Colour',
          [
            ['object_error', 'object error'],
            ['generation', 'generation'],
          ],
          colourBy(),
          (value) => state.set({ colour: value }),
        ),
      );
      const columns = [...genes(), ...measures(), 'generation'].map((name) => [name, unit(name)]);
      replace(
        scatterTools,
        choice('Along x', columns, axis('sx'), (value) => state.set({ sx: value })),
        choice('Along y', columns, axis('sy'), (value) => state.set({ sy: value })),
      );
      const toggle = (name) => (event) => {
        const rest = shown.filter((other) => other !== name);
        state.set({
          axes: genes()
            .filter((gene) => (gene === name ? event.target.checked : rest.includes(gene)))
            .join(','),
        });
      };
      const boxes = genes().map((name) =>
        h(
          'label',
          { class: 'inline' },
          h('input', { type: 'checkbox', checked: shown.includes(name), onchange: toggle(name) }),
          name,
        ),
      );
      replace(
        axesBox,
        h('summary', null, `Axes: ${shown.length} of ${genes().length} genes`),
        h('div', { class: 'siblings' }, boxes),
      );
      drawRanges(rows, [...shown, ...measures()]);
    }

    function drawRanges(rows, names) {
      const { columns } = store.individuals;
      replace(
        rangeBox,
        names.map((name) => {
          const present = extent(
            rows.map((row) => columns[name][row]),
            { margin: 0 },
          );
          const field = (which, text, fallback) =>
            h('input', {
              type: 'number',
              step: 'any',
              'data-range': `${name} ${which}`,
              'aria-label': `${name}, ${text}`,
              placeholder: number(fallback),
              onchange: (event) => setEnd(name, which, event.target.value),
            });
          return h(
            'div',
            null,
            h('span', null, unit(name)),
            field(0, 'at least', present[0]),
            'to',
            field(1, 'at most', present[1]),
          );
        }),
      );
    }

    function setEnd(name, which, text) {
      const range = [...(parseBrush(state.get('brush')).get(name) ?? [-Infinity, Infinity])];
      range[which] = text === '' ? (which === 0 ? -Infinity : Infinity) : Number(text);
      setRange(name, range.every((end) => !Number.isFinite(end)) ? null : range);
    }

    function fillRanges(ranges) {
      for (const input of rangeBox.querySelectorAll('input')) {
        if (input === document.activeElement) continue;
        const at = input.dataset.range.lastIndexOf(' ');
        const end = ranges.get(input.dataset.range.slice(0, at))?.[Number(input.dataset.range.slice(at + 1))];
        input.value = Number.isFinite(end) ? String(Number(end.toPrecision(5))) : '';
      }
    }

    async function fetchLandscape(a, b) {
      const both = genes().includes(a) && genes().includes(b) && a !== b;
      const key = both ? `${store.run?.id} ${a} ${b}` : null;
      if (landscape.key === key) return;
      landscape = { key, value: null };
      setText(landscapeNote, '');
      if (key === null || store.run === null) return;
      try {
        const value = prepareLandscape(await context.api.get('/api/landscape', { id: store.run.id, a, b }));
        if (landscape.key !== key) return;
        landscape.value = value;
        const [low, high] = value.domain;
        setText(
          landscapeNote,
          `Beneath: the best error of the whole grid for each pair of values, ${percent(low)} to ${percent(high)}.`,
        );
      } catch (error) {
        if (landscape.key === key)
          setText(
            landscapeNote,
            error.status === 404
              ? 'No grid of this search space is known: coordinator exhaust makes one.'
              : error.message,
          );
      }
      draw();
    }

    function frontRows() {
      const { front } = store.detail ?? {};
      if (!front) return [];
      const { generation, individual } = front.columns;
      return generation.map((of, row) => store.rowOf(of, individual[row])).filter((row) => row !== undefined);
    }

    function drawFront() {
      const front = store.detail?.front ?? null;
      frontPanel.hidden = front === null;
      lineagePanel.classList.toggle('wide', front !== null);
      if (front === null || frontPanel.dataset.rows === String(front.rows)) return;
      frontPanel.dataset.rows = String(front.rows);
      frontChart?.destroy();
      const { columns } = front;
      const place = h('div', null);
      replace(frontPlace, place, plainTable('Front', front, FRONT));
      const across = columns.cost ? 'cost' : 'size';
      const of = (wins) =>
        columns[across]
          .map((x, row) => [x, columns.train_object_error[row], columns.winner[row]])
          .filter(([, , winner]) => winner === wins)
          .map(([x, y]) => [x, y]);
      let domain;
      const paint = () =>
        frontChart.draw({
          label: `Front of ${front.rows} descriptors, ${across} against training error.`,
          x: { title: across === 'cost' ? 'Counted cost (≈ ns a cloud)' : 'Values a cloud', format: count, domain },
          y: { title: 'Training error', format: (value) => percent(value, 1) },
          series: [
            { name: 'front', colour: '--c1', symbol: 'circle', only: true, points: of(false) },
            { name: 'winner', colour: '--c2', symbol: 'square', only: true, points: of(true) },
          ],
          bands: [],
          lines: [],
        });
      frontChart = createChart(place, {
        height: 260,
        onzoom: (next) => {
          domain = next ?? undefined;
          paint();
        },
      });
      paint();
    }

    function drawTable(rows, shown) {
      const names = [...shown, ...measures()];
      if (tableColumns !== names.join()) {
        tableColumns = names.join();
        const of = (name) => (row) => store.individuals.columns[name]?.[row];
        const id = (row) => `${of('generation')(row)}.${of('individual')(row)}`;
        table = createTable({
          caption: 'Individuals',
          key: id,
          signature: (row) => String(state.get('selected') === id(row)),
          page: 25,
          sort: 'object_error:ascending',
          getSort: () => state.get('sort'),
          setSort: (sort) => state.set({ sort }),
          rowClass: (row) => (state.get('selected') === id(row) ? 'selected' : ''),
          columns: [
            {
              id: 'individual',
              title: 'Individual',
              header: true,
              value: (row) => of('generation')(row) * 1e6 + of('individual')(row),
              node: (row) =>
                h(
                  'button',
                  { class: 'small', 'aria-label': `lineage of ${id(row)}`, onclick: () => select(row) },
                  id(row),
                ),
            },
            ...names.map((name) => ({
              id: name,
              title: unit(name),
              number: true,
              value: of(name),
              text: (row) => cell(name, of(name)(row)),
            })),
            { id: 'elite', title: 'Elite', value: of('elite') },
            { id: 'remembered', title: 'Remembered', value: of('remembered') },
            { id: 'worker', title: 'Worker', value: of('worker') },
            { id: 'queued_seconds', title: 'Waited', number: true, value: of('queued_seconds') },
            { id: 'run_seconds', title: 'Ran', number: true, value: of('run_seconds') },
          ],
        });
        replace(tablePlace, table.element);
      }
      table.set(rows.filter((row) => store.passes(row)));
    }

    function drawLineage(shown) {
      const [generation, individual] = (state.get('selected') ?? '').split('.').map(Number);
      const row = store.rowOf(generation, individual);
      lineagePlace.hidden = row === undefined;
      descriptorButton.hidden = row === undefined;
      lineageNote.hidden = row !== undefined;
      if (row !== undefined) lineage.show(row, shown);
      return row;
    }

    function draw() {
      if (store.individuals === null || store.detail === null) return;
      const { columns, omitted } = store.individuals;
      const all = scopeRows();
      const rows = all.slice(-MOST_DRAWN);
      const shown = shownGenes(all);
      const ranges = parseBrush(state.get('brush'));
      drawTools(rows, shown);
      fillRanges(ranges);
      const parts = [`${plural(all.length, 'individual')}`];
      if (rows.length < all.length) parts.push(`the last ${count(rows.length)} are drawn`);
      if (omitted) parts.push(`${count(omitted)} older ones have not been loaded`);
      setText(note, `${parts.join('; ')}.`);
      const selected = drawLineage(shown);
      const by = colourBy();
      const colourDomain = extent(
        rows.map((row) => columns[by][row]),
        { margin: 0 },
      );
      replace(
        legend,
        rampLegend(by === 'generation' ? 'Generation' : 'Object error', colourDomain, (value) => cell(by, value)),
      );
      const passes = (row) => store.passes(row);
      const common = { rows, table: columns, ranges, passes, colourBy: by, colourDomain, selected };
      const format = (name, value) => (/error$/.test(name) ? percent(value, 0) : number(value));
      parallel.draw({
        ...common,
        columns: [...shown, ...measures()],
        format,
        title: unit,
        label: `Parallel coordinates of ${rows.length} individuals, ${shown.length} genes.`,
      });
      const [x, y] = [axis('sx'), axis('sy')];
      fetchLandscape(x, y);
      scatter.draw({
        ...common,
        x,
        y,
        xTitle: unit(x),
        yTitle: unit(y),
        xFormat: (value) => format(x, value),
        yFormat: (value) => format(y, value),
        landscape: landscape.value,
        front: frontRows(),
        label: `Scatter of ${rows.length} individuals, ${unit(x)} against ${unit(y)}.`,
      });
      drawFront();
      drawTable(all, shown);
    }

    return {
      update(changed) {
        if (['individuals', 'filter', 'state', 'detail'].some((name) => changed.has(name))) draw();
      },
      destroy() {
        parallel.destroy();
        scatter.destroy();
        lineage.destroy();
        frontChart?.destroy();
      },
    };
  },
};
