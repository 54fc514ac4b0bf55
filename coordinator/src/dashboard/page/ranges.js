// The brush as numbers: the least and the highest value of each column, for keyboards and exact values.

import { extent } from './axes.js';
import { h, replace } from './dom.js';
import { number } from './format.js';

const ENDS = [
  { text: 'at least', open: -Infinity },
  { text: 'at most', open: Infinity },
];

/**
 * @param {HTMLElement} root
 * @param {function(string, [number, number]|null): void} onchange with a column and its range, or null for none
 */
export function createRanges(root, onchange) {
  let inputs = [];
  let drawn = '';
  let now = new Map();

  function change(name, which, text) {
    const range = [...(now.get(name) ?? [-Infinity, Infinity])];
    range[which] = text === '' ? ENDS[which].open : Number(text);
    onchange(name, range.some(Number.isFinite) ? range : null);
  }

  function field(name, which, placeholder) {
    const element = h('input', {
      type: 'number',
      step: 'any',
      'aria-label': `${name}, ${ENDS[which].text}`,
      placeholder: number(placeholder),
      onchange: (event) => change(name, which, event.target.value),
    });
    inputs.push({ name, which, element });
    return element;
  }

  return {
    /** Shows fields for columns of a table over some rows, with the ranges of now. */
    draw(table, names, rows, ranges, title) {
      now = ranges;
      if (names.join() !== drawn) {
        drawn = names.join();
        inputs = [];
        const line = (name) => {
          const present = extent(
            rows.map((row) => table[name][row]),
            { margin: 0 },
          );
          return h(
            'div',
            null,
            h('span', null, title(name)),
            field(name, 0, present[0]),
            'to',
            field(name, 1, present[1]),
          );
        };
        replace(root, names.map(line));
      }
      for (const { name, which, element } of inputs) {
        if (element === document.activeElement) continue;
        const end = ranges.get(name)?.[which];
        element.value = Number.isFinite(end) ? String(Number(end.toPrecision(5))) : '';
      }
    },
  };
}
