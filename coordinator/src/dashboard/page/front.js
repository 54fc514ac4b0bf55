// The front of a search of several objectives: cost or size against error, and its points as a table.

import { createChart } from './chart.js';
import { h, replace } from './dom.js';
import { count, percent } from './format.js';
import { plainTable } from './table.js';

/** The columns of a front that people compare, with their titles. */
export const FRONT_COLUMNS = [
  ['point', 'Point'],
  ['generation', 'Generation'],
  ['individual', 'Individual'],
  ['train_object_error', 'Training error'],
  ['validation_object_error', 'Validation error'],
  ['cost', 'Cost (≈ ns)'],
  ['size', 'Values a cloud'],
  ['winner', 'Winner'],
];

/**
 * @param {HTMLElement} root
 */
export function createFront(root) {
  let chart = null;
  let shown = '';

  function paint(front, domain) {
    const { columns } = front;
    const across = columns.cost ? 'cost' : 'size';
    const points = (wins) =>
      columns[across]
        .map((x, row) => [x, columns.train_object_error[row]])
        .filter((_, row) => columns.winner[row] === wins);
    const look = { symbol: 'circle', only: true };
    chart.draw({
      label: `Front of ${front.rows} descriptors, ${across} against training error.`,
      x: { title: across === 'cost' ? 'Counted cost (≈ ns a cloud)' : 'Values a cloud', format: count, domain },
      y: { title: 'Training error', format: (value) => percent(value, 1) },
      series: [
        { name: 'front', colour: '--c1', ...look, points: points(false) },
        { name: 'winner', colour: '--c2', ...look, symbol: 'square', points: points(true) },
      ],
      bands: [],
      lines: [],
    });
  }

  return {
    /** Shows the table `front`. */
    show(front) {
      const key = JSON.stringify(front);
      if (key === shown) return;
      shown = key;
      chart?.destroy();
      const place = h('div', null);
      replace(root, place, plainTable('Front', front, FRONT_COLUMNS));
      chart = createChart(place, { height: 260, onzoom: (domain) => paint(front, domain ?? undefined) });
      paint(front);
    },
    destroy() {
      chart?.destroy();
    },
  };
}
