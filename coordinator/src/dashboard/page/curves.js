// How runs converged: their tables of generations, fetched for comparison, as points and as bands over seeds.

const AT_ONCE = 2;
const GRID = 240;

/** What may lie along x. */
export const AXES = {
  generations: 'Generation',
  evaluations: 'Evaluations computed',
  time: 'Time at work',
};

/** The x of every generation. */
export function positions(columns, axis) {
  if (axis === 'generations') return columns.generation;
  let sum = 0;
  const steps = axis === 'time' ? columns.seconds : columns.evaluations_computed;
  return steps.map((step) => (sum += step ?? 0));
}

/** [x, y] of one column; `of` maps a cell to y. */
export function curve(columns, axis, name, of = (value) => value) {
  const cells = columns[name] ?? [];
  return positions(columns, axis).map((x, row) => {
    const value = cells[row];
    return [x, value === null || value === undefined ? null : of(value)];
  });
}

/** The least training error up to each generation. */
export const bestCurve = (columns, axis) => curve(columns, axis, 'best_so_far_fitness', (fitness) => 1 - fitness);

/** Runs that differ in the seed only: the variant of a sweep's member, or else the run itself. */
export function groupOf(run) {
  if (run.sweep === null) return run.id;
  const variant = (run.member ?? run.id).replace(/-?seed-\d+$/, '');
  return variant === '' ? run.sweep : `${run.sweep}/${variant}`;
}

const median = (sorted) => {
  const middle = sorted.length >> 1;
  return sorted.length % 2 === 1 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
};

/** Median, least and highest of several step curves: {middle: [[x, y]], band: [[x, low, high]]}. */
export function bandOf(curves) {
  const xs = [...new Set(curves.flatMap((points) => points.map(([x]) => x)))].sort((a, b) => a - b);
  const every = Math.max(1, Math.ceil(xs.length / GRID));
  const grid = xs.filter((_, index) => index % every === 0 || index === xs.length - 1);
  const places = curves.map(() => 0);
  const [middle, band] = [[], []];
  for (const x of grid) {
    const values = [];
    curves.forEach((points, which) => {
      while (places[which] + 1 < points.length && points[places[which] + 1][0] <= x) places[which]++;
      const [at, y] = points[places[which]] ?? [Infinity, null];
      if (at <= x && y !== null) values.push(y);
    });
    if (values.length < curves.length) continue;
    values.sort((a, b) => a - b);
    middle.push([x, median(values)]);
    band.push([x, values[0], values[values.length - 1]]);
  }
  return { middle, band };
}

/**
 * Fetches generations of runs, two at a time, and keeps them.
 * @param {function(): void} onchange called when more has come
 */
export function createCurves(api, onchange) {
  const known = new Map();
  const waiting = [];
  const stop = new AbortController();
  let busy = 0;

  function next() {
    while (!stop.signal.aborted && busy < AT_ONCE && waiting.length > 0) fetchOne(waiting.shift());
  }

  async function fetchOne(id) {
    const entry = known.get(id);
    busy++;
    try {
      const { rows, columns } = await api.get('/api/generations', { id }, stop.signal);
      Object.assign(entry, { columns, seen: rows === 0 ? 0 : columns.generation[rows - 1], problem: null });
    } catch (error) {
      entry.problem = error.message;
    }
    busy--;
    entry.busy = false;
    if (stop.signal.aborted) return;
    onchange();
    next();
  }

  return {
    /** Asks for the generations of a run up to its last one. */
    want(run) {
      if (!known.has(run.id)) known.set(run.id, { columns: {}, seen: 0, busy: false, problem: null });
      const entry = known.get(run.id);
      // A run that began anew has fewer generations than were seen.
      if (run.generation < entry.seen) Object.assign(entry, { columns: {}, seen: 0 });
      if (entry.busy || entry.seen >= run.generation) return;
      entry.busy = true;
      waiting.push(run.id);
      next();
    },
    /** The columns of a run's generations, or null if nothing has come yet. */
    of(id) {
      const entry = known.get(id);
      return entry && entry.seen > 0 ? entry.columns : null;
    },
    /** Why the last attempt to fetch a run failed, or null. */
    problem: (id) => known.get(id)?.problem ?? null,
    close: () => stop.abort(),
  };
}
