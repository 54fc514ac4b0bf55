// The list of wrong answers, by pair of objects, the most frequent pair first.
import { shortName } from './cloud-cache.js';
import { h } from './dom.js';
import { number } from './format.js';

const AT_FIRST = 300;

/** Makes the list; `onSelect(row)` is told which answer was chosen, `onOpen(row)` which one by Enter or a click. */
export function createWrongList({ onSelect, onOpen }) {
  const element = h('div', { class: 'scroll wrong-list', role: 'region', 'aria-label': 'Wrong answers' });
  let flat = [];
  let lines = new Map();
  let most = AT_FIRST;
  let shown = { pairs: [], selected: null };

  function show(pairs, selected) {
    const same = pairs === shown.pairs;
    flat = same ? flat : pairs.flatMap((pair) => pair.rows);
    most = Math.max(same ? most : AT_FIRST, flat.findIndex((row) => row.cloud === selected) + 1);
    shown = { pairs, selected };
    if (!same || lines.size < Math.min(most, flat.length)) render();
    lines.forEach(({ line, button }, cloud) => {
      line.classList.toggle('selected', cloud === selected);
      if (cloud === selected) button.setAttribute('aria-current', 'true');
      else button.removeAttribute('aria-current');
    });
  }

  function render() {
    lines = new Map();
    let left = most;
    const bodies = [];
    for (const pair of shown.pairs) {
      if (left <= 0) break;
      const rows = pair.rows.slice(0, left);
      left -= rows.length;
      const times = `${pair.rows.length} of ${pair.queries} ${pair.queries === 1 ? 'cloud' : 'clouds'}`;
      const title = h(
        'th',
        { scope: 'rowgroup', colspan: '3' },
        h('strong', null, pair.own),
        ' taken for ',
        h('strong', null, pair.other),
        h('span', { class: 'muted' }, `, ${times}`),
      );
      bodies.push(h('tbody', null, h('tr', { class: 'pair' }, title), rows.map(makeLine)));
    }
    const head = h(
      'tr',
      null,
      ['Cloud', 'Nearest cloud'].map((text) => h('th', { scope: 'col' }, text)),
      h('th', { scope: 'col', class: 'number' }, 'Distance'),
    );
    const table = h(
      'table',
      null,
      h('caption', { class: 'hidden' }, 'Wrong answers by pair of objects, the most frequent first'),
      h('thead', null, head),
      bodies,
    );
    const more = () => {
      most += AT_FIRST;
      render();
      show(shown.pairs, shown.selected);
    };
    const rest = flat.length - lines.size;
    element.replaceChildren(table, rest > 0 ? h('button', { onclick: more }, `Show more (${rest} left)`) : '');
  }

  function makeLine(row) {
    const button = h('button', { class: 'link', onclick: () => onOpen(row) }, shortName(row.cloud));
    const line = h(
      'tr',
      null,
      h('td', null, button),
      h('td', { title: row.nearest }, shortName(row.nearest)),
      h('td', { class: 'number' }, number(row.distance)),
    );
    lines.set(row.cloud, { line, button });
    return line;
  }

  /** Selects the answer `by` places further on; says whether there is one. */
  function step(by) {
    const at = flat.findIndex((row) => row.cloud === shown.selected);
    const row = flat[Math.max(0, Math.min(flat.length - 1, at + by))];
    if (!row || row.cloud === shown.selected) return;
    const focused = element.contains(document.activeElement);
    onSelect(row);
    reveal(focused);
  }

  /** Scrolls the list, not the page, to the selected answer, and gives it the focus if wanted. */
  function reveal(focus) {
    const found = lines.get(shown.selected);
    if (!found) return;
    const [box, line] = [element.getBoundingClientRect(), found.line.getBoundingClientRect()];
    if (line.top < box.top + 60 || line.bottom > box.bottom) element.scrollTop += line.top - box.top - box.height / 3;
    if (focus) found.button.focus({ preventScroll: true });
  }

  element.addEventListener('keydown', (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!by || event.ctrlKey || event.altKey || event.metaKey || !event.target.closest('button.link')) return;
    event.preventDefault();
    // From the focus, which Tab may have taken elsewhere.
    const at = flat.findIndex((row) => lines.get(row.cloud)?.button === event.target);
    const row = flat[Math.max(0, Math.min(flat.length - 1, at + by))];
    if (!row) return;
    onSelect(row);
    reveal(true);
  });

  return {
    element,
    show,
    step,
    reveal,
    position: () => [flat.findIndex((row) => row.cloud === shown.selected), flat.length],
  };
}
