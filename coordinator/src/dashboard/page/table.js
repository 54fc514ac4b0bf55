// Sortable tables that show a page of their rows and change only the cells that differ.

import { h, setText } from './dom.js';
import { count, cell as formatCell } from './format.js';

const collator = new Intl.Collator('en', { numeric: true });

const compare = (a, b) => {
  const none = (value) => value === null || value === undefined || Number.isNaN(value);
  if (none(a) || none(b)) return none(a) - none(b);
  if (typeof a === 'number' && typeof b === 'number') return a - b;
  return collator.compare(String(a), String(b));
};

/** `key:descending` of the address as {id, descending}. */
function parseSort(text) {
  const [id, order] = (text ?? '').split(':');
  return { id, descending: order === 'descending' };
}

function meanings(columns) {
  const explained = columns.filter(({ hint }) => hint);
  if (explained.length === 0) return null;
  const list = explained.map(({ title, hint }) => [h('dt', null, title), h('dd', null, hint)]);
  return h(
    'details',
    { class: 'data' },
    h('summary', null, 'What the columns mean'),
    h('dl', { class: 'facts' }, list),
  );
}

/**
 * A table. A column is {id, title, hint?, number?, header?, value(row), text?(row), node?(row, element), sortable?}:
 * `value` sorts, `text` is shown; `node` makes the content, which then is kept while the row's `signature` stays.
 * @param {object} options {caption, columns, page?, key(row), signature?(row), empty?, rowClass?(row)}
 * @param {function(): string|null} options.getSort and setSort keep `id:descending` or `id:ascending`
 */
export function createTable(options) {
  const { caption, columns, key, page = 50, empty = 'Nothing yet.' } = options;
  const body = h('tbody', null);
  const heads = new Map();
  let rows = [];
  let first = 0;
  let own = options.sort ?? '';

  const getSort = options.getSort ?? (() => own);
  const sortNow = () => {
    const sort = parseSort(getSort());
    return columns.some(({ id }) => id === sort.id) ? sort : parseSort(options.sort);
  };
  const setSort = (text) => {
    if (options.setSort) options.setSort(text);
    else own = text;
    render();
  };

  const head = columns.map((column) => {
    if (column.sortable === false)
      return h('th', { scope: 'col', class: column.number ? 'number' : null }, column.title);
    const button = h('button', { class: 'sort', onclick: () => toggle(column) }, column.title);
    const element = h('th', { scope: 'col', class: column.number ? 'number' : null }, button);
    heads.set(column.id, element);
    return element;
  });
  const table = h(
    'table',
    null,
    h('caption', { class: 'hidden' }, caption),
    h('thead', null, h('tr', null, head)),
    body,
  );
  const nothing = h('p', { class: 'muted', hidden: true }, empty);
  const place = h('span', { class: 'muted' });
  const step = (text, label, by) => h('button', { class: 'small', 'aria-label': label, onclick: () => move(by) }, text);
  const [before, after] = [step('‹ Previous', 'Previous rows', -page), step('Next ›', 'Next rows', page)];
  const pager = h('div', { class: 'pager', hidden: true }, before, after, place);
  const element = h(
    'div',
    { class: 'table' },
    h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': caption }, table),
    nothing,
    pager,
    meanings(columns),
  );

  function toggle(column) {
    const sort = sortNow();
    const descending = sort.id === column.id ? !sort.descending : Boolean(column.number);
    first = 0;
    setSort(`${column.id}:${descending ? 'descending' : 'ascending'}`);
  }

  function ordered() {
    const sort = sortNow();
    const column = columns.find(({ id }) => id === sort.id);
    if (!column) return rows;
    const sign = sort.descending ? -1 : 1;
    const none = (value) => value === null || value === undefined;
    const keyed = rows.map((row) => [column.value(row), row]);
    keyed.sort(([a], [b]) => (none(a) || none(b) ? compare(a, b) : sign * compare(a, b)));
    return keyed.map(([, row]) => row);
  }

  function move(by) {
    first = Math.max(0, Math.min(first + by, Math.floor((rows.length - 1) / page) * page));
    render();
  }

  function line() {
    const cells = columns.map(({ header, number }) =>
      header ? h('th', { scope: 'row' }) : h('td', { class: number ? 'number' : null }),
    );
    return { element: h('tr', null, cells), cells, key: null, signature: null };
  }

  const lines = [];

  function fill(at, row) {
    lines[at] ??= line();
    const entry = lines[at];
    const [name, signature] = [String(key(row)), options.signature?.(row) ?? ''];
    const same = entry.key === name && entry.signature === signature;
    columns.forEach((column, index) => {
      if (!column.node) {
        setText(entry.cells[index], column.text ? column.text(row) : formatCell(column.id, column.value(row)));
        return;
      }
      if (!same) {
        entry.cells[index].replaceChildren();
        const made = column.node(row, entry.cells[index]);
        if (made !== undefined && made !== null) entry.cells[index].append(...[made].flat());
      }
    });
    if (options.rowClass) entry.element.className = options.rowClass(row) ?? '';
    entry.key = name;
    entry.signature = signature;
    return entry.element;
  }

  function render() {
    const sort = sortNow();
    for (const [id, th] of heads) {
      const order = id === sort.id ? (sort.descending ? 'descending' : 'ascending') : null;
      if (order === null) th.removeAttribute('aria-sort');
      else th.setAttribute('aria-sort', order);
    }
    if (first >= rows.length) first = Math.max(0, Math.floor((rows.length - 1) / page) * page);
    const shown = ordered().slice(first, first + page);
    const elements = shown.map((row, at) => fill(at, row));
    elements.forEach((row, at) => {
      if (body.children[at] !== row) body.insertBefore(row, body.children[at] ?? null);
    });
    while (body.children.length > elements.length) body.lastChild.remove();
    table.hidden = rows.length === 0;
    nothing.hidden = rows.length > 0;
    pager.hidden = rows.length <= page;
    before.disabled = first === 0;
    after.disabled = first + page >= rows.length;
    setText(place, `${count(first + 1)} to ${count(first + shown.length)} of ${count(rows.length)}`);
  }

  return {
    element,
    /** Shows other rows. */
    set(next) {
      rows = next;
      render();
    },
    render,
    /** Turns to the page that has the row of a key and puts it into sight. */
    reveal(name) {
      const at = ordered().findIndex((row) => String(key(row)) === name);
      if (at < 0) return;
      first = Math.floor(at / page) * page;
      render();
      body.children[at - first].scrollIntoView({ block: 'center' });
    },
  };
}

/** A plain table of a columnar one: all its columns, or those named [name, title]. */
export function plainTable(caption, table, names = Object.keys(table.columns).map((name) => [name, name])) {
  const present = names.filter(([name]) => table.columns[name] !== undefined);
  const rows = Array.from({ length: table.rows }, (_, row) =>
    h(
      'tr',
      null,
      present.map(([name], index) => {
        const value = table.columns[name][row];
        const attributes = { class: typeof value === 'number' ? 'number' : null };
        return index === 0
          ? h('th', { scope: 'row' }, formatCell(name, value))
          : h('td', attributes, formatCell(name, value));
      }),
    ),
  );
  const numeric = (name) => table.columns[name].some((value) => typeof value === 'number');
  const head = present.map(([name, title], index) =>
    h('th', { scope: 'col', class: index > 0 && numeric(name) ? 'number' : null }, title),
  );
  const made = h(
    'table',
    null,
    h('caption', { class: 'hidden' }, caption),
    h('thead', null, h('tr', null, head)),
    h('tbody', null, rows),
  );
  return h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': caption }, made);
}
