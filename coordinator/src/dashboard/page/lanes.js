// Attempts sorted into lanes, one a worker, with a slot for each of those that overlap.

/** Kinds of ends: colour, symbol and words. The ends themselves are those of the table `attempts`. */
export const KINDS = {
  answered: { colour: '--c1', symbol: '', title: 'answered' },
  agreed: { colour: '--c3', symbol: '✓', title: 'audit agreed' },
  disagreed: { colour: '--c2', symbol: '✕', title: 'audit disagreed' },
  late: { colour: '--c5', symbol: '…', title: 'late' },
  failed: { colour: '--c4', symbol: '!', title: 'failed or overdue' },
  lost: { colour: '--c7', symbol: '–', title: 'lost with its worker' },
  returned: { colour: '--c6', symbol: '↩', title: 'handed back or dropped' },
};
const KIND_OF = {
  answered: 'answered',
  agreed: 'agreed',
  disagreed: 'disagreed',
  late: 'late',
  failed: 'failed',
  overdue: 'failed',
  lost: 'lost',
  quarantined: 'lost',
  denied: 'lost',
  displaced: 'lost',
};
const MOST_SLOTS = 8;

/** The kind of an end. */
export const kindOf = (end) => KIND_OF[end] ?? 'returned';

const order = new Intl.Collator('en', { numeric: true }).compare;

/** Gives each row of a lane a slot in which no other overlaps it, as far as there are slots. */
function assignSlots(lane, columns) {
  lane.rows.sort((a, b) => columns.handed_out_ms[a] - columns.handed_out_ms[b]);
  const ends = [];
  lane.longest = 0;
  lane.slots = lane.rows.map((row) => {
    const start = columns.handed_out_ms[row];
    let slot = ends.findIndex((end) => end <= start);
    if (slot < 0) slot = ends.length < MOST_SLOTS ? ends.length : row % MOST_SLOTS;
    ends[slot] = Math.max(ends[slot] ?? 0, columns.ended_ms[row]);
    lane.longest = Math.max(lane.longest, columns.ended_ms[row] - start);
    return slot;
  });
  lane.height = Math.max(1, ends.length);
  lane.dirty = false;
}

/** Lanes that grow with the table. */
export function createLanes() {
  let lanes = new Map();
  let names = [];
  let seen = 0;
  let dropped = 0;
  let counts = {};
  let span = [Infinity, -Infinity];

  return {
    /** Takes the rows that have come since. */
    read(table) {
      if (table.rows < seen || (table.omitted ?? 0) !== dropped) {
        lanes = new Map();
        seen = 0;
        counts = {};
        span = [Infinity, -Infinity];
      }
      dropped = table.omitted ?? 0;
      const { worker, handed_out_ms: start, ended_ms: end, end: how } = table.columns;
      const before = lanes.size;
      for (let row = seen; row < table.rows; row++) {
        let lane = lanes.get(worker[row]);
        if (lane === undefined)
          lanes.set(
            worker[row],
            (lane = { worker: worker[row], rows: [], slots: [], height: 1, longest: 0, dirty: true }),
          );
        lane.rows.push(row);
        const kind = kindOf(how[row]);
        counts[kind] = (counts[kind] ?? 0) + 1;
        lane.dirty = true;
        if (start[row] < span[0]) span[0] = start[row];
        if (end[row] > span[1]) span[1] = end[row];
      }
      seen = table.rows;
      if (lanes.size !== before || names.length !== lanes.size) names = [...lanes.keys()].sort(order);
    },
    /** The lane of a worker with its slots up to date, or undefined. */
    of(worker, columns) {
      const lane = lanes.get(worker);
      if (lane?.dirty) assignSlots(lane, columns);
      return lane;
    },
    /** Names of all workers that have a lane, sorted. */
    names: () => names,
    /** How many attempts there are of each kind. */
    counts: () => counts,
    /** The first and last time of all. */
    span: () => span,
  };
}

/** The index of the first row of a lane that may not have ended before a time. */
export function firstAfter(lane, columns, time) {
  let [low, high] = [0, lane.rows.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (columns.handed_out_ms[lane.rows[middle]] < time - lane.longest) low = middle + 1;
    else high = middle;
  }
  return low;
}
