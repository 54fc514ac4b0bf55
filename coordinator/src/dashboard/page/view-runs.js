// All runs below the results folder; those selected are compared.

import { comparedIds, createComparison, setCompared } from './comparison.js';
import { h, replace, setText } from './dom.js';
import { count, duration, moment, percent, plural } from './format.js';
import { generationText, stateBadge } from './run-header.js';
import { createTable } from './table.js';

const ORDER = ['running', 'paused', 'finished', 'unfinished', 'unreadable'];
const has = (run, words) => {
  const text = `${run.id} ${run.name ?? ''} ${run.state} seed ${run.seed ?? ''}`.toLowerCase();
  return words.every((word) => text.includes(word));
};

export const view = {
  id: 'runs',
  title: 'Runs',
  create(root, context) {
    const { state } = context;
    const summary = h('p', { class: 'muted', role: 'status' });
    const search = h('input', {
      type: 'search',
      value: state.get('find') ?? '',
      oninput: () => state.set({ find: search.value }),
    });
    const which = h('select', { onchange: () => state.set({ state: which.value }) });
    replace(
      which,
      h('option', { value: '' }, 'any'),
      ORDER.map((name) => h('option', { value: name }, name)),
    );
    const selection = h('span', { role: 'status' });
    const jump = h(
      'button',
      { class: 'primary', hidden: true, onclick: () => box.scrollIntoView() },
      'Show the comparison',
    );
    const clear = h('button', { class: 'small', onclick: () => setCompared(state, []) }, 'Select none');
    const shownButton = h(
      'button',
      {
        class: 'small',
        onclick: () =>
          setCompared(
            state,
            listed()
              .filter(isRun)
              .map(({ id }) => id)
              .slice(0, 40),
          ),
      },
      'Select all shown',
    );
    const box = h('section', { class: 'panel', hidden: true, 'aria-label': 'Comparison' });
    let comparison = null;

    const isRun = (run) => run.kind === 'run';
    const table = createTable({
      caption: 'Runs',
      key: (run) => run.id,
      signature: (run) =>
        `${run.state} ${comparedIds(state).includes(run.id)} ${run.verdict?.[0] ?? ''} ${run.problem ?? ''}`,
      page: 25,
      sort: 'started:descending',
      getSort: () => state.get('sort'),
      setSort: (sort) => state.set({ sort }),
      empty: 'No run here yet. Start one with coordinator run, for example coordinator run experiments/demo.toml.',
      columns: [
        {
          id: 'select',
          title: 'Compare',
          sortable: false,
          value: () => null,
          node: (run) => (isRun(run) ? tick(run) : null),
        },
        {
          id: 'id',
          title: 'Run',
          header: true,
          value: (run) => run.id,
          node: (run) =>
            [
              run.kind === 'run'
                ? h('a', { href: state.link({ run: run.id }, false) }, run.id)
                : h('span', null, run.id),
              run.kind !== 'run' && h('span', { class: 'kind' }, ` ${run.kind}`),
              run.kind === 'sweep' &&
                h('button', { class: 'small', onclick: () => compareMembers(run) }, 'Compare its members'),
              run.problem && h('div', { class: 'problem' }, run.problem),
            ].filter(Boolean),
        },
        { id: 'state', title: 'State', value: (run) => ORDER.indexOf(run.state), node: (run) => stateBadge(run.state) },
        {
          id: 'generation',
          title: 'Generation',
          number: true,
          value: (run) => run.generation,
          text: (run) => (isRun(run) ? generationText(run) : ''),
        },
        {
          id: 'best',
          title: 'Training error',
          number: true,
          value: (run) => run.best_error,
          text: (run) =>
            percent(run.best_error) + (Number.isFinite(run.weighed_error) ? `, weighed ${percent(run.weighed_error)}` : ''),
        },
        {
          id: 'validation',
          title: 'Validation',
          number: true,
          value: (run) => run.validation_error,
          text: (run) => percent(run.validation_error),
        },
        {
          id: 'test',
          title: 'Test',
          number: true,
          value: (run) => run.test_error,
          text: (run) => percent(run.test_error),
        },
        {
          id: 'regret',
          title: 'Regret',
          number: true,
          value: (run) => run.regret,
          text: (run) => percent(run.regret),
          hint: 'training error above the best of the whole space, where that is known',
        },
        {
          id: 'verdict',
          title: 'Verdict',
          value: (run) => run.verdict?.[0] ?? run.stop_reason,
          node: (run) => h('div', { class: 'verdict-cell' }, run.verdict?.[0] ?? run.stop_reason ?? ''),
        },
        {
          id: 'left',
          title: 'Time left',
          number: true,
          value: (run) => run.seconds_left,
          text: (run) => (run.state === 'running' ? duration(run.seconds_left) : ''),
        },
        {
          id: 'workers',
          title: 'Workers',
          number: true,
          value: (run) => run.workers,
          text: (run) => count(run.workers),
        },
        {
          id: 'seconds',
          title: 'Time',
          number: true,
          value: (run) => run.seconds,
          text: (run) => duration(run.seconds),
        },
        { id: 'started', title: 'Started', value: (run) => run.started_ms, text: (run) => moment(run.started_ms) },
      ],
    });

    function compareMembers(sweep) {
      const members = context.runs.runs.filter((run) => run.sweep === sweep.id);
      setCompared(
        state,
        members.map(({ id }) => id),
      );
      box.scrollIntoView();
    }

    function tick(run) {
      const toggle = (event) => {
        const ids = comparedIds(state).filter((id) => id !== run.id);
        setCompared(state, event.target.checked ? [...ids, run.id] : ids);
      };
      return h('input', {
        type: 'checkbox',
        checked: comparedIds(state).includes(run.id),
        'aria-label': `compare ${run.id}`,
        onchange: toggle,
      });
    }

    function listed() {
      const words = (state.get('find') ?? '').toLowerCase().split(/\s+/).filter(Boolean);
      const wanted = state.get('state');
      return (context.runs?.runs ?? []).filter((run) => has(run, words) && (!wanted || run.state === wanted));
    }

    function drawComparison(runs) {
      const ids = comparedIds(state);
      const selected = ids.map((id) => runs.find((run) => run.id === id)).filter(Boolean);
      setText(
        selection,
        selected.length === 0
          ? 'Select two runs or more to compare them.'
          : `${plural(selected.length, 'run')} selected.`,
      );
      clear.hidden = ids.length === 0;
      box.hidden = selected.length < 2;
      jump.hidden = box.hidden;
      if (box.hidden) {
        comparison?.destroy();
        comparison = null;
        replace(box);
        return;
      }
      if (comparison === null) {
        replace(box, h('h2', null, 'Comparison'));
        comparison = createComparison(box, context);
      }
      comparison.show(selected);
    }

    replace(
      root,
      h('h1', null, 'Runs'),
      summary,
      h(
        'div',
        { class: 'row' },
        h('label', { class: 'field' }, 'Find', search),
        h('label', { class: 'field' }, 'State', which),
        shownButton,
        clear,
        selection,
        jump,
      ),
      h('section', { class: 'panel' }, table.element),
      box,
    );

    return {
      update() {
        const runs = context.runs?.runs ?? [];
        const working = runs.filter((run) => run.state === 'running' && isRun(run)).length;
        setText(
          summary,
          context.runs === null
            ? 'Waiting for the runs …'
            : `${plural(runs.filter(isRun).length, 'run')}, ${count(working)} running. Build ${context.runs.build}`,
        );
        if (document.activeElement !== search) search.value = state.get('find') ?? '';
        which.value = state.get('state') ?? '';
        table.set(listed());
        drawComparison(runs);
      },
      destroy() {
        comparison?.destroy();
      },
    };
  },
};
