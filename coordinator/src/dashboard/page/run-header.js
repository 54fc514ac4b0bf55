// What stands above every view of a run: its name and state, the main figures, the brush, the tabs.

import { parseBrush } from './brush.js';
import { h, replace, setText } from './dom.js';
import { count, duration, number, percent } from './format.js';

const STATES = {
  running: '▶ running',
  paused: '‖ paused',
  finished: '✓ finished',
  unfinished: '○ unfinished',
  unreadable: '✕ unreadable',
};

const STOPS = {
  perfect: 'every training query was named correctly',
  validation: 'validation errors rose',
  stagnation: 'the training fitness no longer improved',
  generations: 'the last generation was reached',
  evaluations: 'the budget of evaluations was spent',
  exhaustive: 'the whole grid was evaluated',
};

/** The state of a run as a badge: colour, symbol and word. */
export function stateBadge(state) {
  return h('span', { class: `badge ${state}` }, STATES[state] ?? String(state));
}

/** The text of the generation: `7 of 20`. */
export function generationText(run) {
  return run.generations ? `${count(run.generation)} of ${count(run.generations)}` : count(run.generation);
}

function figures(run) {
  const list = [
    ['Generation', generationText(run)],
    ['Training error', percent(run.best_error), 'of the best so far'],
    ['Validation error', percent(run.validation_error)],
    ['Test error', percent(run.test_error)],
  ];
  if (run.optimum_error !== null) list.push(['Known optimum', percent(run.optimum_error), 'of the whole space']);
  if (run.regret !== null) list.push(['Regret', percent(run.regret), 'above the optimum']);
  list.push([
    'Evaluations',
    `${count(run.evaluations_computed)} + ${count(run.evaluations_remembered)}`,
    'computed + remembered',
  ]);
  if (run.workers !== null) list.push(['Workers', count(run.workers)]);
  if (run.state === 'running' && run.seconds_left !== null) list.push(['Time left', `≈ ${duration(run.seconds_left)}`]);
  list.push(['Time', duration(run.seconds)]);
  return list;
}

/**
 * @param {HTMLElement} root
 * @param {{id: string, title: string}[]} views
 */
export function createRunHeader(root, views, context) {
  const { store, state } = context;
  const title = h('div', { class: 'run-title' });
  const strip = h('dl', { class: 'figures' });
  const chip = h('div', { class: 'brush-chip', hidden: true, role: 'status' });
  const tabs = h('nav', { class: 'tabs', 'aria-label': 'Views of the run' });
  const problem = h('p', { class: 'problem', hidden: true });
  const box = h(
    'section',
    { class: 'run-header', hidden: true, 'aria-label': 'The run on show' },
    title,
    strip,
    problem,
    tabs,
    chip,
  );
  root.append(box);
  let id = null;
  let drawnTitle = '';

  function drawTitle() {
    const { run } = store;
    const key = JSON.stringify([id, run?.state, run?.stop_reason, run?.sweep]);
    if (key === drawnTitle) return;
    drawnTitle = key;
    replace(
      title,
      h('a', { href: '#' }, 'Runs'),
      h('span', { class: 'muted', 'aria-hidden': 'true' }, '›'),
      h('h1', null, id),
      run && stateBadge(run.state),
      run?.stop_reason && h('span', { class: 'muted' }, STOPS[run.stop_reason] ?? run.stop_reason),
      h('span', { class: 'spacer' }),
      h('a', { class: 'button', href: `/api/report?id=${encodeURIComponent(id)}`, download: '' }, 'Export report'),
    );
  }

  function drawFigures() {
    const { run } = store;
    strip.hidden = run === null;
    problem.hidden = !run?.problem;
    if (run === null) return;
    setText(problem, run.problem ?? '');
    const list = figures(run);
    while (strip.children.length > list.length) strip.lastChild.remove();
    list.forEach(([name, text, hint], index) => {
      if (!strip.children[index])
        strip.append(h('div', null, h('dt', null), h('dd', null, h('span', null), h('small', null))));
      const [dt, dd] = strip.children[index].children;
      setText(dt, name);
      setText(dd.children[0], text);
      setText(dd.children[1], hint ?? '');
    });
  }

  function drawChip() {
    const ranges = parseBrush(state.get('brush'));
    chip.hidden = ranges.size === 0;
    if (chip.hidden) return;
    let passing = 0;
    const rows = store.individuals?.rows ?? 0;
    for (let row = 0; row < rows; row++) if (store.passes(row)) passing++;
    const end = (value) => (Number.isFinite(value) ? number(value) : '…');
    const texts = [...ranges].map(([name, [low, high]]) => `${name} ${end(low)} to ${end(high)}`);
    replace(
      chip,
      h('strong', null, 'Brushed: '),
      `${texts.join(', ')} · ${count(passing)} of ${count(rows)} individuals. All views show only these and who computed them.`,
      h('button', { class: 'small', onclick: () => state.set({ brush: null }) }, 'Clear the brush'),
    );
  }

  return {
    /** Another run, or none, or another view is shown. */
    route(run, view) {
      id = run;
      box.hidden = run === null;
      if (run === null) return;
      drawTitle();
      replace(
        tabs,
        views.map((item) =>
          h('a', { href: state.link({ view: item.id }), 'aria-current': item.id === view ? 'page' : null }, item.title),
        ),
      );
      const current = tabs.querySelector('[aria-current]');
      if (current) tabs.scrollLeft = current.offsetLeft - tabs.offsetLeft - 20;
      drawChip();
    },
    /** Something of the run has changed. */
    update(changed) {
      if (id === null) return;
      if (changed.has('run')) {
        drawTitle();
        drawFigures();
      }
      if (changed.has('filter') || changed.has('individuals') || changed.has('state')) drawChip();
    },
  };
}
