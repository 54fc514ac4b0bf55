// How the channels of a descriptor share in distances: bars of parts, and a table with their numbers.
import { h } from './dom.js';
import { number } from './format.js';

/**
 * `distances`: `[{name, total, parts: [one a channel]}]`; `channels`: `[{name, weight}]`. The table has a column for each
 * distance and, of two, their difference, of one, its shares.
 */
export function channelBars(channels, distances) {
  const longest = Math.max(1e-12, ...distances.map(({ total }) => total));
  const bars = distances.map(({ name, total, parts }) => {
    const told = channels.map((channel, i) => `${channel.name} ${number(parts[i])}`).join(', ');
    const segments = parts.map((part, i) => {
      const share = (100 * part) / longest;
      const text = share > 12 ? `${channels[i].name} ${Math.round((100 * part) / (total || 1))} %` : '';
      const segment = h('span', { class: `segment channel-${i % 7}` }, h('span', null, text));
      segment.style.width = `${share}%`;
      return segment;
    });
    const bar = h('div', { class: 'bar', role: 'img', 'aria-label': `${name}: ${number(total)}; ${told}` }, segments);
    return h(
      'div',
      { class: 'bar-line' },
      h('span', { class: 'bar-name' }, name),
      bar,
      h('span', { class: 'number' }, number(total)),
    );
  });
  return h(
    'div',
    { class: 'channel-bars' },
    bars,
    h(
      'div',
      { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Parts of the channels' },
      table(channels, distances),
    ),
  );
}

function table(channels, distances) {
  const both = distances.length === 2;
  const signed = (value) => (value > 0 ? `+${number(value)}` : number(value).replace('-', '−'));
  const cell = (text) => h('td', { class: 'number' }, text);
  const head = (text) => h('th', { scope: 'col', class: 'number' }, text);
  const line = (name, weight, values, mark) =>
    h(
      'tr',
      null,
      h('th', { scope: 'row' }, mark, name),
      cell(weight),
      values.map((value) => cell(number(value))),
      both
        ? cell(signed(values[1] - values[0]))
        : cell(`${((100 * values[0]) / (distances[0].total || 1)).toFixed(1)} %`),
    );
  const lines = channels.map((channel, i) =>
    line(
      channel.name,
      number(channel.weight),
      distances.map(({ parts }) => parts[i]),
      h('span', { class: `key channel-${i % 7}` }),
    ),
  );
  const sum = line(
    'together',
    '',
    distances.map(({ total }) => total),
    null,
  );
  return h(
    'table',
    { class: 'parts' },
    h('caption', null, 'Weighted part of each channel'),
    h(
      'thead',
      null,
      h(
        'tr',
        null,
        h('th', { scope: 'col' }, 'Channel'),
        head('Weight'),
        distances.map(({ name }) => head(name)),
        head(both ? 'Difference' : 'Share'),
      ),
    ),
    h('tbody', null, lines),
    h('tfoot', null, sum),
  );
}
