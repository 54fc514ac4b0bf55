// One wrong answer: the query, the answer and the right cloud side by side in 3D, and why the answer was nearer.
import { channelBars } from './channel-bars.js';
import { shortName } from './cloud-cache.js';
import { h } from './dom.js';
import { number } from './format.js';
import { createViewer, link } from './viewer.js';

const ROLES = [
  { key: 'query', mark: '?', title: 'Query' },
  { key: 'answer', mark: '✕', title: 'Answer, wrong' },
  { key: 'right', mark: '✓', title: 'Nearest of the right object' },
];

/** Makes the panel; `load(path)` fetches a cloud, `explain(row)` asks how the distances come about. */
export function createTriple({ load, explain }) {
  const views = ROLES.map(({ key, mark, title }) => {
    const canvas = h('canvas', { class: 'cloud' });
    const name = h('strong');
    const more = h('span', { class: 'muted' });
    const problem = h('span', { class: 'problem' });
    const role = h('span', { class: `role ${key}` }, h('span', { 'aria-hidden': 'true' }, `${mark} `), title);
    const element = h(
      'figure',
      { class: `cloud-figure ${key}` },
      canvas,
      h('figcaption', null, role, name, more, problem),
    );
    return { element, viewer: createViewer(canvas, { label: title }), name, more, problem, title, path: null };
  });
  link(views.map(({ viewer }) => viewer));
  const figures = h('dl', { class: 'figures' });
  const reason = h('div');
  const clouds = h(
    'div',
    { class: 'clouds' },
    views.map(({ element }) => element),
  );
  const reset = h('button', { class: 'small', onclick: () => views[0].viewer.fit() }, 'Reset view');
  const hint = h(
    'p',
    { class: 'muted hint' },
    'One camera for all three: drag or arrow keys turn, the wheel zooms after a click. ',
    reset,
  );
  const element = h('div', { class: 'triple' }, clouds, hint, figures, reason);
  let turn = 0;

  async function place(view, path, object, distance, now) {
    view.name.textContent = object;
    view.more.textContent = path
      ? `${shortName(path)}${distance === null ? '' : `, distance ${number(distance)}`}`
      : 'none in the database';
    view.more.title = path ?? '';
    view.problem.textContent = '';
    if (view.path === path) return;
    view.path = path;
    view.viewer.setCloud(null, `${view.title}: ${object}`);
    if (!path) return;
    try {
      const cloud = await load(path);
      if (turn === now || view.path === path)
        view.viewer.setCloud(cloud, `${view.title}: ${object}, ${shortName(path)}`);
    } catch (error) {
      if (view.path !== path) return;
      view.path = null;
      view.problem.textContent = error.message;
    }
  }

  /**
   * Shows a row; a `note` of the explanation is said above the channels, such as that they are of another descriptor.
   * Resolves to false if something could not be had.
   */
  async function show(row) {
    const now = ++turn;
    const [query, answer, right] = views;
    place(query, row.cloud, row.instance, null, now);
    place(answer, row.nearest, row.predicted, row.distance, now);
    right.name.textContent = row.instance;
    element.setAttribute('aria-busy', 'true');
    try {
      const told = await explain(row);
      if (turn !== now) return true;
      place(right, told.right, row.instance, told.note ? null : told.right_distance, now);
      describe(row, told);
      return true;
    } catch (error) {
      if (turn !== now) return true;
      place(right, null, row.instance, null, now);
      right.more.textContent = 'not known';
      figures.replaceChildren();
      if (reason.textContent !== error.message) {
        reason.replaceChildren(h('p', { class: 'problem', role: 'alert' }, error.message));
      }
      return false;
    } finally {
      if (turn === now) element.removeAttribute('aria-busy');
    }
  }

  function describe(row, told) {
    const term = (name, value, hint) =>
      h('div', null, h('dt', null, name), h('dd', null, value, hint ? h('small', null, ` ${hint}`) : null));
    const note = told.note ?? null;
    const own = note === null;
    const margin = told.margin === null ? '–' : `${told.margin > 0 ? '+' : ''}${number(told.margin).replace('-', '−')}`;
    figures.replaceChildren(
      term('Distance to the answer', number(own ? told.answer_distance : row.distance)),
      ...(own
        ? [
            term('to the right object', number(told.right_distance)),
            term('Margin', margin, 'right − answer'),
            term('Decided by', told.decided_by, 'the channel'),
          ]
        : []),
      term('Runner-up', number(row.runnerUpDistance), shortName(row.runnerUp ?? '')),
    );
    const distances = [
      { name: 'answer', total: told.answer_distance, parts: told.channels.map((c) => c.answer_distance) },
    ];
    if (told.right_distance !== null) {
      distances.push({ name: 'right', total: told.right_distance, parts: told.channels.map((c) => c.right_distance) });
    }
    reason.replaceChildren(
      h('h3', null, 'Channels of the distances'),
      note ? h('p', { class: 'notice' }, note) : '',
      h('p', { class: 'muted' }, told.descriptor),
      channelBars(told.channels, distances),
    );
  }

  return { element, show, dispose: () => views.forEach(({ viewer }) => viewer.dispose()) };
}
