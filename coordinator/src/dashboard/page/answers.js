// Wrong answers as rows, filtered, and grouped into pairs of objects.

/** Rows of the table of `/api/answers`. */
export function readAnswers(table) {
  const c = table.columns;
  return Array.from({ length: table.rows }, (_, i) => ({
    cloud: c.cloud[i],
    instance: c.instance[i],
    category: c.category[i],
    nearest: c.nearest_cloud[i],
    predicted: c.predicted_instance[i],
    predictedCategory: c.predicted_category[i],
    distance: c.distance[i],
    runnerUp: c.runner_up_cloud[i],
    runnerUpDistance: c.runner_up_distance[i],
    wrong: !c.correct_object[i],
    wrongCategory: !c.correct_category[i],
  }));
}

/** Whether a row is of the category and has the text; `filter` is `{category, find}`. */
export function inScope(row, { category, find }) {
  if (category && row.category !== category && row.predictedCategory !== category) return false;
  const words = (find ?? '').toLowerCase().split(/\s+/).filter(Boolean);
  const text = `${row.cloud} ${row.instance} ${row.predicted} ${row.nearest}`.toLowerCase();
  return words.every((word) => text.includes(word));
}

/** Whether a row is of the object, or pair of objects, or pair of categories, that is picked. */
export function isPicked(row, { object, as, by }) {
  const [own, other] = by === 'category' ? [row.category, row.predictedCategory] : [row.instance, row.predicted];
  return (!object || own === object) && (!as || other === as);
}

export const byName = (a, b) => a.localeCompare(b, 'en', { numeric: true });

/** Pairs `{own, other, rows, queries}` of wrong rows, the most frequent first; `all` gives the number of queries. */
export function pairsOf(wrong, all) {
  const queries = new Map();
  all.forEach((row) => queries.set(row.instance, (queries.get(row.instance) ?? 0) + 1));
  const pairs = new Map();
  for (const row of wrong) {
    const key = `${row.instance}\n${row.predicted}`;
    const known = pairs.get(key) ?? { own: row.instance, other: row.predicted, rows: [], queries: 0 };
    known.rows.push(row);
    known.queries = queries.get(row.instance);
    pairs.set(key, known);
  }
  const sorted = [...pairs.values()].sort(
    (a, b) => b.rows.length - a.rows.length || byName(a.own, b.own) || byName(a.other, b.other),
  );
  sorted.forEach((pair) => pair.rows.sort((a, b) => byName(a.cloud, b.cloud)));
  return sorted;
}
