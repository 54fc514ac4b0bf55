// Where an individual comes from: its ancestors through the generations, drawn by error and listed.

import { drawAxes, extent, linear } from './axes.js';
import { h, onWidth, replace, svg } from './dom.js';
import { count, number, percent, plural } from './format.js';
import { createTable } from './table.js';

const MOST = 400;
const HEIGHT = 280;
const MARGIN = { top: 26, right: 16, bottom: 42, left: 58 };

/** Rows of an individual and its ancestors, the youngest first; `more` if there are too many to show. */
function ancestors(store, row) {
  const { generation, individual, parent_a: a, parent_b: b } = store.individuals.columns;
  const rows = [row];
  const links = [];
  const seen = new Set([row]);
  let unknown = 0;
  let more = false;
  for (let at = 0; at < rows.length; at++) {
    const child = rows[at];
    const parents = new Set([a[child], b[child]].filter((parent) => parent !== null && parent !== undefined));
    for (const parent of parents) {
      const found = store.rowOf(generation[child] - 1, parent);
      if (found === undefined) {
        unknown++;
        continue;
      }
      if (!seen.has(found)) {
        if (rows.length >= MOST) {
          more = true;
          continue;
        }
        seen.add(found);
        rows.push(found);
      }
      links.push([child, found]);
    }
  }
  return { rows, links, unknown, more, name: (of) => `${generation[of]}.${individual[of]}` };
}

/** The beginning of a gene's name that says its slot; '' if it has none. */
const slotOf = (gene) => /^s\d+_/.exec(gene)?.[0] ?? '';

/**
 * What an individual has of neither parent, in words. Slots may have changed places: a gene of a slot is compared with
 * those at its place, or, if that leaves fewer, with those of the slot of a parent that is most alike.
 */
export function novelty(store, genes, row) {
  const { columns } = store.individuals;
  const parents = [columns.parent_a[row], columns.parent_b[row]]
    .filter((parent) => parent !== null && parent !== undefined)
    .map((parent) => store.rowOf(columns.generation[row] - 1, parent))
    .filter((found) => found !== undefined);
  if (columns.elite?.[row]) return 'copied (elite)';
  if (parents.length === 0) return 'without parents';
  const slots = [...new Set(genes.map(slotOf))];
  const fresh = slots.flatMap((slot) => {
    const own = genes.filter((gene) => slotOf(gene) === slot);
    const atPlace = own.filter((gene) => parents.every((parent) => columns[gene][parent] !== columns[gene][row]));
    const places = slot === '' ? [] : slots.filter((place) => place !== '');
    const elsewhere = parents.flatMap((parent) =>
      places.map((place) =>
        own.filter((gene) => columns[place + gene.slice(slot.length)]?.[parent] !== columns[gene][row]),
      ),
    );
    return [atPlace, ...elsewhere].reduce((least, some) => (some.length < least.length ? some : least));
  });
  return fresh.length === 0
    ? 'all genes of its parents'
    : `new: ${fresh.map((gene) => `${gene} ${number(columns[gene][row])}`).join(', ')}`;
}

/**
 * @param {HTMLElement} root
 * @param {object} context of the page
 * @param {function(number): void} onselect with a row of individuals
 */
export function createLineage(root, context, onselect) {
  const { store } = context;
  const said = h('p', { role: 'status' });
  const picture = svg('svg', { role: 'img', height: HEIGHT, class: 'lineage' });
  const place = h('div', null, picture);
  const list = h('div', null);
  root.append(said, place, list);
  let width = 0;
  let shown = null;
  let table = null;
  let tableGenes = '';

  function draw() {
    if (width === 0 || shown === null) return;
    const { columns } = store.individuals;
    const { rows, links, row: selected } = shown;
    const generations = rows.map((row) => columns.generation[row]);
    const first = Math.min(...generations);
    const last = Math.max(...generations);
    const x = linear([first - 0.4, last + 0.4], [MARGIN.left, width - MARGIN.right]);
    const y = linear(extent(rows.map((row) => columns.object_error[row])), [HEIGHT - MARGIN.bottom, MARGIN.top]);
    const every = Math.max(1, Math.ceil((last - first + 1) / ((width - 80) / 40)));
    const xTicks = [];
    for (let generation = last; generation >= first; generation -= every) xTicks.push(generation);
    const at = (row) => [x(columns.generation[row]), y(columns.object_error[row])];
    const lines = links
      .map(([child, parent]) => {
        const [[cx, cy], [px, py]] = [at(child), at(parent)];
        return `M${px.toFixed(1)} ${py.toFixed(1)}L${cx.toFixed(1)} ${cy.toFixed(1)}`;
      })
      .join('');
    const nodes = rows.map((row) => {
      const [cx, cy] = at(row);
      return svg(
        'circle',
        {
          class: row === selected ? 'node selected' : 'node',
          cx,
          cy,
          r: row === selected ? 7 : 4.5,
          onclick: () => onselect(row),
        },
        svg('title', null, shown.name(row)),
      );
    });
    picture.setAttribute('viewBox', `0 0 ${width} ${HEIGHT}`);
    picture.setAttribute('width', width);
    picture.setAttribute(
      'aria-label',
      `Ancestors of ${shown.name(selected)} by generation and error. They are listed below.`,
    );
    replace(
      picture,
      drawAxes({
        x,
        y,
        xTitle: 'Generation',
        yTitle: 'Object error',
        xFormat: count,
        yFormat: (value) => percent(value, 1),
        xTicks,
      }),
      svg('path', { class: 'links', d: lines }),
      nodes,
    );
  }

  function tableFor(genes) {
    const cell = (name) => (row) => store.individuals.columns[name][row];
    const parents = (row) =>
      [cell('parent_a')(row), cell('parent_b')(row)].filter((parent) => parent !== null && parent !== undefined);
    return createTable({
      caption: 'The individual and its ancestors',
      key: (row) => shown.name(row),
      page: 15,
      sort: 'generation:descending',
      rowClass: (row) => (row === shown.row ? 'selected' : ''),
      columns: [
        { id: 'generation', title: 'Generation', number: true, value: cell('generation') },
        {
          id: 'individual',
          title: 'Individual',
          number: true,
          header: true,
          value: cell('individual'),
          node: (row) =>
            h(
              'button',
              { class: 'small', 'aria-label': `lineage of ${shown.name(row)}`, onclick: () => onselect(row) },
              shown.name(row),
            ),
        },
        { id: 'object_error', title: 'Error', number: true, value: cell('object_error') },
        ...genes.map((gene) => ({ id: gene, title: gene, number: true, value: cell(gene) })),
        {
          id: 'parents',
          title: 'Parents',
          value: (row) => parents(row)[0],
          text: (row) =>
            [...new Set(parents(row))].map((parent) => `${cell('generation')(row) - 1}.${parent}`).join(' × ') || '–',
        },
        { id: 'origin', title: 'What is new', value: (row) => novelty(store, genes, row) },
        {
          id: 'worker',
          title: 'Computed by',
          value: (row) => cell('worker')(row) ?? (cell('remembered')(row) ? 'remembered' : null),
        },
      ],
    });
  }

  const stop = onWidth(place, (now) => {
    width = now;
    draw();
  });

  return {
    /** Shows the lineage of a row. */
    show(row, genes) {
      shown = { ...ancestors(store, row), row };
      const { rows, unknown, more } = shown;
      const first = store.individuals.columns.generation[rows[rows.length - 1]];
      const parts = [
        `Individual ${shown.name(row)} has ${plural(rows.length - 1, 'ancestor')} back to generation ${first}.`,
      ];
      if (more) parts.push(`Only the ${MOST} nearest are shown.`);
      if (unknown > 0) parts.push('Older ones have not been loaded.');
      said.textContent = parts.join(' ');
      if (tableGenes !== genes.join()) {
        tableGenes = genes.join();
        table = tableFor(genes);
        replace(list, table.element);
      }
      table.set(rows);
      draw();
    },
    destroy() {
      stop();
    },
  };
}
