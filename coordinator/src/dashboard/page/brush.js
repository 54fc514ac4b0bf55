// The brush: ranges of columns of the individuals. It stands in the address and filters every view.

const SAFE = /^-?\d+(\.\d+)?(e[+-]?\d+)?$/i;

/** `R1:0.5..1.2;object_error:..0.2` as a map from column to [low, high]. */
export function parseBrush(text) {
  const ranges = new Map();
  for (const part of (text ?? '').split(';')) {
    const at = part.lastIndexOf(':');
    const ends = part.slice(at + 1).split('..');
    if (at < 1 || ends.length !== 2) continue;
    const low = SAFE.test(ends[0]) ? Number(ends[0]) : -Infinity;
    const high = SAFE.test(ends[1]) ? Number(ends[1]) : Infinity;
    if (low !== -Infinity || high !== Infinity) ranges.set(part.slice(0, at), [low, high]);
  }
  return ranges;
}

/** The text of such a map, or null if it is empty. */
export function printBrush(ranges) {
  const end = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(6))) : '');
  const parts = [...ranges].map(([name, [low, high]]) => `${name}:${end(low)}..${end(high)}`);
  return parts.length === 0 ? null : parts.join(';');
}

/** Whether a row of `individuals` lies in all ranges; a null lies in none. */
export function brushPredicate(store, ranges) {
  if (ranges.size === 0) return null;
  return (row) => {
    const { columns } = store.individuals;
    for (const [name, [low, high]] of ranges) {
      const value = columns[name]?.[row];
      if (value === null || value === undefined || value < low || value > high) return false;
    }
    return true;
  };
}

/** Which workers computed the individuals that pass, as name -> how many; null without a filter. */
export function passingWorkers(store) {
  if (!store.filtered() || store.individuals === null) return null;
  const workers = new Map();
  const { columns, rows } = store.individuals;
  for (let row = 0; row < rows; row++) {
    const worker = columns.worker?.[row];
    if (worker && store.passes(row)) workers.set(worker, (workers.get(worker) ?? 0) + 1);
  }
  return workers;
}
