// The individuals: parallel coordinates, a scatter over the landscape, the front; brushing, and lineages.

import { extent } from './axes.js';
import { parseBrush, printBrush } from './brush.js';
import { choice, h, replace, setText } from './dom.js';
import { cell, count, number, percent, plural } from './format.js';
import { createFront } from './front.js';
import { createLineage } from './lineage.js';
import { createParallel } from './parallel.js';
import { rampLegend } from './ramp.js';
import { createRanges } from './ranges.js';
import { createScatter, prepareLandscape } from './scatter.js';
import { createTable } from './table.js';

const MOST_DRAWN = 20_000;
const MOST_AT_FIRST = 6_000;
const AXES_AT_FIRST = 10;
const GENERATIONS_TO_CHOOSE = 500;
const MEASURES = ['object_error', 'category_error', 'cost', 'size', 'margin'];
const COLOURS = [
  ['object_error', 'object error'],
  ['generation', 'generation'],
];
const HINT = 'Drag along an axis to brush it, click a brushed axis to clear it, click a line for its lineage.';

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

/** The columns that vary, or of many those that most rows have. */
function informative(table, names, rows) {
  const candidates = varying(table, names, rows);
  if (candidates.length <= AXES_AT_FIRST) return candidates;
  const filled = new Map(
    candidates.map((name) => [name, rows.reduce((sum, row) => sum + (typeof table[name][row] === 'number'), 0)]),
  );
  const best = [...candidates].sort((a, b) => filled.get(b) - filled.get(a)).slice(0, AXES_AT_FIRST);
  return candidates.filter((name) => best.includes(name));
}

/** The table of individuals with the columns of some names; `select` takes a row. */
function individualsTable({ store, state }, names, title, select) {
  const of = (name) => (row) => store.individuals.columns[name]?.[row];
  const id = (row) => `${of('generation')(row)}.${of('individual')(row)}`;
  const chosen = (row) => state.get('selected') === id(row);
  const button = (row) =>
    h('button', { class: 'small', 'aria-label': `lineage of ${id(row)}`, onclick: () => select(row) }, id(row));
  const place = (row) => of('generation')(row) * 1e6 + of('individual')(row);
  return createTable({
    caption: 'Individuals',
    key: id,
    page: 25,
    sort: 'object_error:ascending',
    getSort: () => state.get('sort'),
    setSort: (sort) => state.set({ sort }),
    rowClass: (row) => (chosen(row) ? 'selected' : ''),
    empty: 'No individual passes the brush.',
    columns: [
      { id: 'individual', title: 'Individual', header: true, value: place, node: button },
      ...names.map((name) => ({ id: name, title: title(name), number: true, value: of(name) })),
      { id: 'elite', title: 'Elite', value: of('elite') },
      { id: 'remembered', title: 'Remembered', value: of('remembered') },
      { id: 'worker', title: 'Worker', value: of('worker') },
      { id: 'queued_seconds', title: 'Waited', number: true, value: of('queued_seconds') },
      { id: 'run_seconds', title: 'Ran', number: true, value: of('run_seconds') },
    ],
  });
}

/** The landscape of two genes, fetched when they change: `of` gives it once it is there. */
function createLandscape(context, note, onready) {
  let key = null;
  let value = null;
  return {
    async want(a, b, genes) {
      const run = context.store.run?.id;
      const next = run && a !== b && genes.includes(a) && genes.includes(b) ? `${run} ${a} ${b}` : null;
      if (next === key) return;
      [key, value] = [next, null];
      setText(note, '');
      if (next === null) return;
      try {
        const fetched = prepareLandscape(await context.api.get('/api/landscape', { id: run, a, b }));
        if (key !== next) return;
        value = fetched;
        const [low, high] = value.domain.map((error) => percent(error));
        setText(note, `Beneath: the best error of the whole grid for each pair of values, ${low} to ${high}.`);
      } catch (error) {
        if (key !== next) return;
        const unknown = 'No grid of this search space is known: coordinator exhaust makes one.';
        setText(note, error.status === 404 ? unknown : error.message);
        return;
      }
      onready();
    },
    of: () => value,
  };
}

export const view = {
  id: 'population',
  title: 'Population',
  create(root, context) {
    const { store, state } = context;
    const section = (title, ...children) => h('section', { class: 'panel' }, h('h2', null, title), ...children);
    const box = () => h('div', null);
    const muted = (text) => h('p', { class: 'muted', role: 'status' }, text);
    const [parallelPlace, legend, scatterPlace, lineagePlace, frontPlace, tablePlace] = Array.from({ length: 6 }, box);
    const [scopeTools, scatterTools] = [h('div', { class: 'row' }), h('div', { class: 'row' })];
    const [note, landscapeNote] = [muted(''), muted('')];
    const lineageNote = muted('Click an individual, or choose one in the table, to see where it comes from.');
    const axesBox = h('details', null);
    const rangeBox = h('div', { class: 'ranges' });
    const rangeDetails = h(
      'details',
      { open: state.get('brush') !== null },
      h('summary', null, 'Ranges by numbers'),
      rangeBox,
    );
    const descriptorButton = h('button', { onclick: () => context.navigate('descriptor') }, 'What it looks at');
    const lineagePanel = section('Lineage', lineageNote, descriptorButton, lineagePlace);
    const frontPanel = section('Front', frontPlace);
    replace(
      root,
      section(
        'Parallel coordinates',
        scopeTools,
        note,
        parallelPlace,
        legend,
        h('p', { class: 'muted' }, HINT),
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
    const scatter = createScatter(scatterPlace, { onbrush: brushBoth, onselect: select });
    const lineage = createLineage(lineagePlace, context, select);
    const ranges = createRanges(rangeBox, setRange);
    const front = createFront(frontPlace);
    const landscape = createLandscape(context, landscapeNote, () => draw());
    let table = null;
    let tableNames = '';
    let toolsKey = '';

    function select(row) {
      const { generation, individual } = store.individuals.columns;
      state.set({ selected: `${generation[row]}.${individual[row]}` });
      lineagePanel.scrollIntoView({ block: 'nearest' });
    }

    function setRange(name, range) {
      const all = parseBrush(state.get('brush'));
      if (range === null) all.delete(name);
      else all.set(name, range);
      state.set({ brush: printBrush(all) });
    }

    function brushBoth({ x, y }) {
      const all = parseBrush(state.get('brush'));
      const [first, second] = scatterAxes(shownGenes(scopeRows()));
      all.set(first, x);
      all.set(second, y);
      state.set({ brush: printBrush(all) });
    }

    const genes = () => store.detail.genes.map(({ name }) => name).filter((name) => store.individuals.columns[name]);
    const measures = () => MEASURES.filter((name) => store.individuals.columns[name]?.some((value) => value !== null));
    const scope = () => state.get('scope') ?? (store.individuals.rows > MOST_AT_FIRST ? 'last' : 'all');
    const colourBy = () => (state.get('colour') === 'generation' ? 'generation' : 'object_error');
    const format = (name, value) => (/error$/.test(name) ? percent(value, 0) : number(value));

    function title(name) {
      const unit = store.detail.genes.find((gene) => gene.name === name)?.unit;
      return unit ? `${name} (${unit})` : name.replace(/_/g, ' ');
    }

    function scopeRows() {
      const { rows, columns } = store.individuals;
      const wanted = scope();
      const of = wanted === 'last' ? columns.generation[rows - 1] : Number(wanted);
      const found = [];
      for (let row = 0; row < rows; row++) if (wanted === 'all' || columns.generation[row] === of) found.push(row);
      return found;
    }

    /** The genes on axes: those chosen, or the most informative ones. */
    function shownGenes(rows) {
      const chosen = state
        .get('axes')
        ?.split(',')
        .filter((name) => genes().includes(name));
      return chosen?.length ? chosen : informative(store.individuals.columns, genes(), rows);
    }

    /** The columns along x and y of the scatter: two genes where there is a landscape, else a gene and the error. */
    function scatterAxes(shown) {
      const known = (key) => (store.individuals.columns[state.get(key)] ? state.get(key) : null);
      const hasGrid = typeof store.run?.optimum_error === 'number';
      return [
        known('sx') ?? shown[0] ?? 'generation',
        known('sy') ?? (hasGrid && shown[1] ? shown[1] : 'object_error'),
      ];
    }

    function drawTools(shown) {
      const generations = [...new Set(store.individuals.columns.generation)].sort((a, b) => b - a);
      const [x, y] = scatterAxes(shown);
      const key = JSON.stringify([
        generations[0],
        generations.length,
        scope(),
        colourBy(),
        x,
        y,
        shown,
        genes().length,
      ]);
      if (key === toolsKey) return;
      toolsKey = key;
      const scopes = [
        ['all', 'all loaded'],
        ['last', 'the last generation'],
        ...generations.slice(0, GENERATIONS_TO_CHOOSE).map((value) => [String(value), `generation ${value}`]),
      ];
      replace(
        scopeTools,
        choice('Individuals of', scopes, scope(), (value) => state.set({ scope: value })),
        choice('Colour', COLOURS, colourBy(), (value) => state.set({ colour: value })),
      );
      const columns = [...genes(), ...measures(), 'generation'].map((name) => [name, title(name)]);
      replace(
        scatterTools,
        choice('Along x', columns, x, (value) => state.set({ sx: value })),
        choice('Along y', columns, y, (value) => state.set({ sy: value })),
      );
      const toggle = (name) => (event) => {
        const next = genes().filter((gene) => (gene === name ? event.target.checked : shown.includes(gene)));
        state.set({ axes: next.join(',') });
      };
      const tick = (name) => h('input', { type: 'checkbox', checked: shown.includes(name), onchange: toggle(name) });
      const boxes = genes().map((name) => h('label', { class: 'inline' }, tick(name), name));
      const text = `Axes: ${shown.length} of ${genes().length} genes`;
      replace(axesBox, h('summary', null, text), h('div', { class: 'siblings' }, boxes));
    }

    function drawNote(all, drawn) {
      const { omitted, omittedGenerations } = store.individuals;
      const parts = [plural(all.length, 'individual')];
      if (drawn.length < all.length) parts.push(`the last ${count(drawn.length)} are drawn`);
      const early = plural(omittedGenerations ?? 0, 'generation');
      if (omittedGenerations) parts.push(`those of the first ${early} have not been loaded`);
      if (omitted) parts.push(`${count(omitted)} older ones are no longer kept`);
      setText(note, `${parts.join('; ')}.`);
    }

    function frontRows() {
      if (!store.detail.front) return [];
      const { generation, individual } = store.detail.front.columns;
      return generation.map((of, row) => store.rowOf(of, individual[row])).filter((row) => row !== undefined);
    }

    function drawFront() {
      const known = store.detail.front !== null;
      frontPanel.hidden = !known;
      lineagePanel.classList.toggle('wide', known);
      if (known) front.show(store.detail.front);
    }

    function drawTable(rows, shown) {
      const names = [...shown, ...measures()];
      if (tableNames !== names.join()) {
        tableNames = names.join();
        table = individualsTable(context, names, title, select);
        replace(tablePlace, table.element);
      }
      table.set(rows.filter((row) => store.passes(row)));
    }

    /** Shows the lineage of the individual in the address, if it has been loaded, and returns its row. */
    function drawLineage(shown) {
      const [generation, individual] = (state.get('selected') ?? '').split('.').map(Number);
      const row = store.rowOf(generation, individual);
      for (const element of [lineagePlace, descriptorButton]) element.hidden = row === undefined;
      lineageNote.hidden = row !== undefined;
      if (row !== undefined) lineage.show(row, shown);
      return row;
    }

    function drawMarks(rows, shown, selected) {
      const { columns } = store.individuals;
      const by = colourBy();
      const domain = extent(
        rows.map((row) => columns[by][row]),
        { margin: 0 },
      );
      replace(
        legend,
        rampLegend(title(by), domain, (value) => cell(by, value)),
      );
      const brush = parseBrush(state.get('brush'));
      const passes = (row) => store.passes(row);
      const common = { rows, table: columns, ranges: brush, passes, colourBy: by, colourDomain: domain, selected };
      const names = [...shown, ...measures()];
      ranges.draw(columns, names, rows, brush, title);
      const text = `Parallel coordinates of ${rows.length} individuals, ${shown.length} genes.`;
      parallel.draw({ ...common, columns: names, format, title, label: text });
      const [x, y] = scatterAxes(shown);
      landscape.want(x, y, genes());
      scatter.draw({
        ...common,
        x,
        y,
        xTitle: title(x),
        yTitle: title(y),
        xFormat: (value) => format(x, value),
        yFormat: (value) => format(y, value),
        landscape: landscape.of(),
        front: frontRows(),
        label: `Scatter of ${rows.length} individuals, ${title(x)} against ${title(y)}.`,
      });
    }

    function draw() {
      if (store.individuals === null || store.detail === null) return;
      const all = scopeRows();
      const rows = all.slice(-MOST_DRAWN);
      const shown = shownGenes(all);
      drawTools(shown);
      drawNote(all, rows);
      drawMarks(rows, shown, drawLineage(shown));
      drawFront();
      drawTable(all, shown);
    }

    return {
      update(changed) {
        if (['individuals', 'filter', 'state', 'detail'].some((name) => changed.has(name))) draw();
      },
      destroy() {
        for (const part of [parallel, scatter, lineage, front]) part.destroy();
      },
    };
  },
};
