// All that is known of the run on show: tables that grow as the stream brings rows, and the filters over them.

const KEEP_ROWS = 200_000;
const EMPTY = {
  run: null,
  detail: null,
  generations: null,
  individuals: null,
  attempts: null,
  events: null,
  fleet: null,
};

/** The keys of rows that have come already: a stream begins again a little before the place where it broke off. */
const KEYS = {
  generations: (columns, row) => columns.generation[row],
  individuals: (columns, row) => columns.generation[row] * 1_048_576 + columns.individual[row],
  attempts: (columns, row) => columns.sequence[row],
};

function append(table, keys, more, keyOf) {
  const { columns } = table;
  const old = table.rows;
  const added = [];
  for (let row = 0; row < more.rows; row++) {
    const key = keyOf(more.columns, row);
    if (keys.has(key)) continue;
    keys.set(key, old + added.length);
    added.push(row);
  }
  for (const [name, values] of Object.entries(more.columns)) {
    columns[name] ??= new Array(old).fill(null);
    const column = columns[name];
    for (const row of added) column.push(values[row]);
  }
  table.rows = old + added.length;
  for (const column of Object.values(columns)) {
    while (column.length < table.rows) column.push(null);
  }
  return added.length > 0;
}

function dropOldest(table, keys, keyOf) {
  if (table.rows <= KEEP_ROWS * 1.2) return false;
  const drop = table.rows - KEEP_ROWS;
  for (const name of Object.keys(table.columns)) table.columns[name] = table.columns[name].slice(drop);
  table.rows = KEEP_ROWS;
  table.omitted = (table.omitted ?? 0) + drop;
  keys.clear();
  for (let row = 0; row < table.rows; row++) keys.set(keyOf(table.columns, row), row);
  return true;
}

const highest = (column) => {
  let most = 0;
  for (const value of column ?? []) if (value > most) most = value;
  return most;
};

/**
 * @param {function(string): void} announce called with the name of what has changed
 */
export function createStore(announce) {
  const filters = new Map();
  let keys = {};
  let mask = [];
  let generation = { generations: 0, individuals: 0 };
  let sequence = 0;

  const store = {
    ...EMPTY,

    /** Forgets the run. */
    reset() {
      Object.assign(store, EMPTY);
      keys = { generations: new Map(), individuals: new Map(), attempts: new Map() };
      mask = [];
      generation = { generations: 0, individuals: 0 };
      sequence = 0;
      for (const name of Object.keys(EMPTY)) announce(name);
    },

    /** Sets `run`, `detail` or `fleet`. */
    put(name, value) {
      store[name] = value;
      announce(name);
    },

    /** Adds rows of `generations`, `individuals` or `attempts`. */
    add(name, more) {
      store[name] ??= { rows: 0, columns: {}, omitted: 0 };
      const table = store[name];
      if (more.omitted_generations) table.omittedGenerations = more.omitted_generations;
      const changed = append(table, keys[name], more, KEYS[name]);
      if (name === 'attempts') sequence = Math.max(sequence, highest(more.columns.sequence));
      else generation[name] = Math.max(generation[name], highest(more.columns.generation));
      if (dropOldest(table, keys[name], KEYS[name])) mask = [];
      if (changed) announce(name);
    },

    /** Adds events. */
    addEvents(more) {
      store.events ??= [];
      const known = new Set(store.events.map((event) => event.sequence));
      const added = more.filter((event) => !known.has(event.sequence));
      store.events = [...store.events, ...added].slice(-KEEP_ROWS);
      sequence = Math.max(sequence, highest(more.map((event) => event.sequence)));
      if (added.length > 0) announce('events');
    },

    /** From where a broken stream goes on. */
    position: () => ({ generation: Math.min(generation.generations, generation.individuals), event: sequence }),

    /** The row of an individual in `individuals`, or undefined. */
    rowOf: (of, individual) => keys.individuals?.get(of * 1_048_576 + individual),

    /** Whether a row of `individuals` passes all filters. */
    passes(row) {
      if (filters.size === 0) return true;
      mask[row] ??= [...filters.values()].every((predicate) => predicate(row));
      return mask[row];
    },

    /** Whether there is any filter. */
    filtered: () => filters.size > 0,

    /** Sets or, with null, removes a filter: a predicate over rows of `individuals`. */
    setFilter(key, predicate) {
      if (predicate === null && !filters.has(key)) return;
      if (predicate === null) filters.delete(key);
      else filters.set(key, predicate);
      mask = [];
      announce('filter');
    },
  };
  keys = { generations: new Map(), individuals: new Map(), attempts: new Map() };
  return store;
}
