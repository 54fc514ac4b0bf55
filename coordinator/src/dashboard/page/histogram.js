// The histograms of a channel for two clouds, side by side: bars, heat maps for several dimensions, and tables.
import { h, svg } from './dom.js';
import { number } from './format.js';

const product = (bins) => bins.reduce((all, n) => all * n, 1);

/** Divides values by a layout `[{name, bins}]` into `[{name, bins, from, to}]`. */
export function divide(layout, length) {
  let from = 0;
  const parts = layout.map(({ name, bins }) => {
    const part = { name, bins, from, to: from + product(bins) };
    from = part.to;
    return part;
  });
  if (from !== length) {
    throw new Error(
      `histograms: the layout and the values differ, got ${from} bins, ${length} values\nreload the page`,
    );
  }
  return parts;
}

/** The histograms of a channel of `/api/explain`; `names` are those of the two clouds. */
export function histograms(channel, names) {
  const both = [channel.query, channel.answer];
  const parts = divide(channel.layout, channel.query.length).map((part) => {
    const values = both.map((all) => all.slice(part.from, part.to));
    const most = Math.max(1e-12, ...values.flat());
    const flat = part.bins.length < 2;
    const figures = values.map((own, i) => {
      const label = `${channel.name}, ${part.name}, ${names[i]}: ${tellOf(own, part.bins)}`;
      const picture = flat ? bars(own, values[1 - i], most, i, label) : heat(own, part.bins, most, i, label);
      return h(
        'figure',
        { class: flat ? 'bars' : 'heat' },
        picture,
        h('figcaption', null, h('span', { class: `cloud-mark cloud-${i}` }, 'AB'[i]), ` ${names[i]}`),
      );
    });
    const size = `${part.bins.join(' × ')} bins, highest ${number(most)}`;
    return h(
      'div',
      { class: 'histogram' },
      h('h4', null, part.name, h('small', { class: 'muted' }, ` ${size}`)),
      h('div', { class: 'pair-of' }, figures),
      numbers(part, values, names),
    );
  });
  return h('div', { class: 'histograms' }, parts);
}

function tellOf(values, bins) {
  const most = Math.max(...values);
  const at = values.indexOf(most);
  const empty = values.filter((value) => value === 0).length;
  return `${bins.join(' by ')} bins, the highest ${number(most)} in ${place(at, bins)}, ${empty} empty`;
}

/** The name of a bin, from 1: `bin 3`, or of several dimensions `bin 2, 5`. */
function place(at, bins) {
  let rest = at;
  const indices = bins.toReversed().map((n) => {
    const index = rest % n;
    rest = (rest - index) / n;
    return index + 1;
  });
  return `bin ${indices.toReversed().join(', ')}`;
}

function bars(own, other, most, cloud, label) {
  const top = (value) => 100 - (96 * Math.max(0, value)) / most;
  const columns = own.map((value, i) =>
    svg(
      'rect',
      { x: i + 0.08, width: 0.84, y: top(value), height: 100 - top(value), class: `fill-${cloud}` },
      svg('title', null, `bin ${i + 1}: ${number(value)}`),
    ),
  );
  const steps = other.map((value, i) => `${i ? 'L' : 'M'}${i} ${top(value)}H${i + 1}`).join('');
  return svg(
    'svg',
    { viewBox: `0 0 ${own.length} 100`, preserveAspectRatio: 'none', role: 'img', 'aria-label': label },
    columns,
    svg('path', { d: steps, class: 'other' }),
    svg('path', { d: `M0 100H${own.length}`, class: 'base' }),
  );
}

function heat(own, bins, most, cloud, label) {
  const rows = bins[0];
  const columns = own.length / rows;
  const cells = own.map((value, i) => {
    const [row, column] = [Math.floor(i / columns), i % columns];
    const cell = svg(
      'rect',
      { x: column, y: row, width: 1, height: 1, class: `fill-${cloud}` },
      svg('title', null, `${place(i, bins)}: ${number(value)}`),
    );
    // The root makes small values visible.
    cell.style.fillOpacity = Math.sqrt(Math.max(0, value) / most);
    return cell;
  });
  return svg(
    'svg',
    { viewBox: `0 0 ${columns} ${rows}`, preserveAspectRatio: 'xMinYMin', role: 'img', 'aria-label': label },
    cells,
  );
}

function numbers(part, values, names) {
  const details = h('details', { class: 'data' }, h('summary', null, 'Numbers'));
  // Thousands of cells are made only for who wants them.
  details.addEventListener('toggle', () => {
    if (details.childElementCount > 1) return;
    const lines = values[0].map((value, i) =>
      h(
        'tr',
        null,
        h('th', { scope: 'row' }, place(i, part.bins)),
        [value, values[1][i], value - values[1][i]].map((cell) =>
          h('td', { class: 'number' }, number(cell).replace('-', '−')),
        ),
      ),
    );
    const heads = ['Bin', ...names.map((name, i) => `${'AB'[i]} ${name}`), 'Difference'];
    const head = h(
      'tr',
      null,
      heads.map((text, i) => h('th', { scope: 'col', class: i ? 'number' : null }, text)),
    );
    const table = h(
      'table',
      null,
      h('caption', { class: 'hidden' }, `Values of ${part.name}`),
      h('thead', null, head),
      h('tbody', null, lines),
    );
    details.append(
      h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': `Values of ${part.name}` }, table),
    );
  });
  return details;
}
