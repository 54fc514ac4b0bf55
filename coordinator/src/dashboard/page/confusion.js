// The confusion matrix: a table of numbers with heat, which is walked through by arrow keys.
import { h } from './dom.js';
import { byName } from './answers.js';

const MOST = 60;

/** Makes a matrix; `onPick(own, other)` is told which cell was chosen. */
export function createConfusion(onPick) {
  const note = h('p', { class: 'muted' });
  const box = h('div', { class: 'scroll confusion' });
  const element = h('div', null, note, box);
  let at = null;

  function show(rows, by, picked) {
    const names =
      by === 'category' ? (row) => [row.category, row.predictedCategory] : (row) => [row.instance, row.predicted];
    const { counts, shown, hidden, most } = count(rows, names);
    const what = by === 'category' ? 'categories' : 'objects';
    note.textContent = `Rows: the ${what} of the clouds. Columns: what they were taken for.`;
    if (hidden > 0) note.textContent += ` The ${shown.length} with most errors of ${shown.length + hidden}.`;
    if (shown.length === 0) note.textContent = `No cloud was taken for another ${by}.`;
    box.hidden = shown.length === 0;
    const hadFocus = box.contains(document.activeElement);
    const home = at && shown.includes(at[0]) && shown.includes(at[1]) ? at : firstError(shown, counts);
    const cells = new Map();
    const body = shown.map((own) => {
      const line = shown.map((other) => {
        const cell = makeCell(own, other, counts.get(own)?.get(other) ?? 0, most);
        if (picked.object === own && (!picked.as || picked.as === other)) cell.classList.add('picked');
        if (home && home[0] === own && home[1] === other) cell.tabIndex = 0;
        cells.set(`${own}\n${other}`, cell);
        return cell;
      });
      return h('tr', null, h('th', { scope: 'row' }, own), line);
    });
    const heads = shown.map((other) => h('th', { scope: 'col' }, h('span', null, other)));
    const table = h(
      'table',
      { role: 'grid', 'aria-label': `Confusion of ${what}; arrow keys move, Enter shows the clouds of a cell` },
      h('thead', null, h('tr', null, h('td', null), heads)),
      h('tbody', null, body),
    );
    table.addEventListener('keydown', (event) => walk(event, shown, cells));
    table.addEventListener('focusin', (event) => enter(event.target, cells));
    box.replaceChildren(table);
    at = home;
    const chosen = box.querySelector('.picked.error') ?? box.querySelector('.picked');
    if (chosen && (!hadFocus || !box.scrollTop))
      box.scrollTo(chosen.offsetLeft - box.clientWidth / 2, chosen.offsetTop - box.clientHeight / 2);
    if (hadFocus && home) cells.get(home.join('\n'))?.focus({ preventScroll: true });
  }

  function makeCell(own, other, amount, most) {
    const same = own === other;
    const label = same ? `${own}: ${amount} right` : `${own} taken for ${other}: ${amount}`;
    const kind = same ? 'same' : amount ? 'error' : 'none';
    const cell = h(
      'td',
      { class: kind, tabindex: '-1', 'aria-label': label, title: label },
      amount ? String(amount) : '',
    );
    if (!same && amount) {
      cell.style.setProperty('--heat', `${Math.round(12 + (40 * amount) / most)}%`);
    }
    cell.pair = [own, other];
    cell.addEventListener('click', () => !same && amount && onPick(own, other));
    return cell;
  }

  function enter(cell, cells) {
    if (!cell.pair) return;
    if (at) cells.get(at.join('\n'))?.setAttribute('tabindex', '-1');
    at = cell.pair;
    cell.tabIndex = 0;
  }

  function walk(event, shown, cells) {
    const pair = event.target.pair;
    if (!pair) return;
    const last = shown.length - 1;
    const steps = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
    const step = steps[event.key] ?? { Home: [0, -last], End: [0, last] }[event.key];
    if (event.key === 'Enter' || event.key === ' ') event.target.click();
    else if (step) {
      const place = pair.map((name, i) => Math.max(0, Math.min(last, shown.indexOf(name) + step[i])));
      cells.get(place.map((i) => shown[i]).join('\n')).focus();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  return { element, show };
}

function firstError(shown, counts) {
  for (const own of shown) {
    for (const other of shown) if (own !== other && counts.get(own)?.get(other)) return [own, other];
  }
  return null;
}

/** Numbers by own and predicted name, and the names that have errors. */
function count(rows, names) {
  const counts = new Map();
  const errors = new Map();
  for (const row of rows) {
    const [own, other] = names(row);
    const line = counts.get(own) ?? new Map();
    counts.set(own, line.set(other, (line.get(other) ?? 0) + 1));
    if (own !== other) [own, other].forEach((name) => errors.set(name, (errors.get(name) ?? 0) + 1));
  }
  const ranked = [...errors].sort((a, b) => b[1] - a[1] || byName(a[0], b[0])).map(([name]) => name);
  const shown = ranked.slice(0, MOST).sort(byName);
  let most = 1;
  for (const own of shown) {
    for (const other of shown) if (own !== other) most = Math.max(most, counts.get(own)?.get(other) ?? 0);
  }
  return { counts, shown, hidden: ranked.length - shown.length, most };
}
