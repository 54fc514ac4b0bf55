// The winners of several runs beside each other: their genes and channels, with what only some of them have left empty.

import { h, replace } from './dom.js';
import { number } from './format.js';

const NONE = '–';

/** Lines `[name, cells, isNumber]` of some runs' details: a channel each, then a gene each; what no run has is left out. */
export function winnerLines(details) {
  const genes = new Map();
  const length = Math.max(0, ...details.map(({ channels }) => channels.length));
  for (const detail of details) {
    for (const { name, unit } of detail.genes) genes.set(name, unit ? `${name} (${unit})` : name);
  }
  const geneOf = ({ genes: own, winner }, name) => winner.values[own.findIndex((gene) => gene.name === name)] ?? null;
  const channelOf = ({ channels }, at) =>
    channels[at] ? `${channels[at].text}, weight ${number(channels[at].weight)}` : null;
  const lines = [['family', details.map(({ family }) => family), false]];
  for (let at = 0; at < length; at++)
    lines.push([`channel ${at + 1}`, details.map((detail) => channelOf(detail, at)), false]);
  for (const [name, title] of genes) lines.push([title, details.map((detail) => geneOf(detail, name)), true]);
  return lines.filter(([, cells]) => cells.some((cell) => cell !== null));
}

/**
 * @param {HTMLElement} root
 * @param {object} api of the page
 * @returns {{show: function(object[]): void, close: function(): void}} `show` takes runs of the list
 */
export function createWinners(root, api) {
  const known = new Map();
  const stop = new AbortController();
  const note = h('p', { class: 'muted', role: 'status' });
  const place = h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Winners of the selected runs' });
  root.append(note, place);
  let runs = [];
  let busy = false;

  /** One after the other: a dashboard reads all tables of a run for its details. */
  async function fetchMissing() {
    if (busy) return;
    busy = true;
    for (let next; (next = runs.find(({ id, state }) => state === 'finished' && !known.has(id))) !== undefined; ) {
      try {
        known.set(next.id, { detail: await api.get('/api/run', { id: next.id }, stop.signal), problem: null });
      } catch (error) {
        known.set(next.id, { detail: null, problem: error.message });
      }
      if (stop.signal.aborted) return;
      draw();
    }
    busy = false;
  }

  function draw() {
    const shown = runs.filter(({ id }) => known.get(id)?.detail?.winner);
    const failed = runs.find(({ id }) => known.get(id)?.problem);
    const open = runs.filter(({ state }) => state !== 'finished').map(({ id }) => id);
    const waits = runs.length - shown.length - open.length;
    note.textContent = failed
      ? `${failed.id}: ${known.get(failed.id).problem}`
      : [open.length > 0 && `No winner yet: ${open.join(', ')}.`, waits > 0 && `Fetching ${waits} winners …`]
          .filter(Boolean)
          .join(' ');
    place.hidden = shown.length === 0;
    if (place.hidden) return;
    const line = ([name, cells, isNumber]) => {
      const differs = cells.some((cell) => cell !== cells[0]);
      const said = differs && [h('span', { 'aria-hidden': 'true' }, ' ≠'), h('span', { class: 'hidden' }, ' (differs)')];
      const written = (cell) => (cell === null ? NONE : isNumber ? number(cell) : cell);
      const cell = (value) => h('td', { class: isNumber ? 'number' : null }, written(value));
      return h('tr', null, h('th', { scope: 'row' }, name, said), cells.map(cell));
    };
    const head = shown.map(({ id }) => h('th', { scope: 'col' }, id));
    replace(
      place,
      h(
        'table',
        null,
        h('caption', { class: 'hidden' }, 'Winners of the selected runs'),
        h('thead', null, h('tr', null, h('th', { scope: 'col' }, 'Gene or channel'), head)),
        h('tbody', null, winnerLines(shown.map(({ id }) => known.get(id).detail)).map(line)),
      ),
    );
  }

  return {
    show(next) {
      runs = next;
      draw();
      fetchMissing();
    },
    close: () => stop.abort(),
  };
}
