// Commands for the run: pause, resume, stop, and the priorities of a sweep's members, each with a reason.

import { giveCommand, refusal } from './command.js';
import { h, replace, setText } from './dom.js';
import { duration, percent } from './format.js';
import { generationText, stateBadge } from './run-header.js';
import { createTable } from './table.js';

const COMMANDS = [
  {
    action: 'pause',
    button: 'Pause',
    text: 'Jobs in hand are finished, no further ones are handed out. Nothing is lost; resuming goes on from here.',
    allowed: (run) => run.state === 'running',
  },
  { action: 'resume', button: 'Resume', text: 'Jobs are handed out again.', allowed: (run) => run.state === 'paused' },
  {
    action: 'stop',
    button: 'Stop',
    danger: true,
    text: 'The search ends, as if its last generation had been reached: the winner so far is measured on the test clouds.',
    allowed: (run) => run.state === 'running' || run.state === 'paused',
  },
];

export const view = {
  id: 'control',
  title: 'Control',
  create(root, context) {
    const { store } = context;
    const why = h('p', { role: 'status' });
    const rows = COMMANDS.map((command) => {
      const button = h('button', { class: command.danger ? 'danger' : 'primary', onclick: () => give(command) }, command.button);
      return { command, button, element: h('div', null, h('dt', null, button), h('dd', null, command.text)) };
    });
    const give = ({ action, button, text, danger }) =>
      giveCommand(context, { title: `${button} ${store.run.id}`, text, button, danger, body: { action } });

    const priority = h('input', { type: 'number', step: 1, value: 0, 'aria-label': 'priority' });
    const setPriority = h(
      'button',
      {
        onclick() {
          const value = Number(priority.value);
          if (!Number.isInteger(value)) {
            priority.setCustomValidity('A whole number, for example 5');
            priority.reportValidity();
            priority.setCustomValidity('');
            return;
          }
          giveCommand(context, {
            title: `Priority ${value} for ${store.run.id}`,
            text: 'Members of a sweep with a higher priority get their jobs done before the others. Results do not change.',
            button: 'Set it',
            body: { action: 'priority', priority: value },
          });
        },
      },
      'Set the priority',
    );
    const members = createTable({
      caption: 'Members of the sweep',
      key: (run) => run.id,
      signature: (run) => run.state,
      page: 50,
      sort: 'id:ascending',
      rowClass: (run) => (run.id === store.run?.id ? 'selected' : ''),
      columns: [
        { id: 'id', title: 'Member', header: true, value: (run) => run.member ?? run.id, node: (run) => h('a', { href: context.state.link({ run: run.id, view: 'control' }, false) }, run.member ?? run.id) },
        { id: 'state', title: 'State', value: (run) => run.state, node: (run) => stateBadge(run.state) },
        { id: 'generation', title: 'Generation', number: true, value: (run) => run.generation, text: generationText },
        { id: 'best', title: 'Training error', number: true, value: (run) => run.best_error, text: (run) => percent(run.best_error) },
        { id: 'left', title: 'Time left', number: true, value: (run) => run.seconds_left, text: (run) => duration(run.seconds_left) },
      ],
    });
    const sweep = h(
      'section',
      { class: 'panel', hidden: true },
      h('h2', null, 'Sweep'),
      h('p', null, 'This run is a member of a sweep; its members share the workers.'),
      h('div', { class: 'row' }, h('label', { class: 'field' }, 'Priority of this member (higher first)', priority), setPriority),
      members.element,
    );
    replace(
      root,
      h('section', { class: 'panel' }, h('h2', null, 'Control'), why, h('dl', { class: 'commands' }, rows.map(({ element }) => element)), h('p', { class: 'muted' }, 'Workers are drained and denied in the fleet.')),
      sweep,
    );

    return {
      update() {
        const refused = refusal(context);
        setText(why, refused ?? '');
        for (const { command, button } of rows) button.disabled = refused !== null || !command.allowed(store.run);
        setPriority.disabled = refused !== null;
        const of = store.run?.sweep ?? null;
        sweep.hidden = of === null;
        if (of !== null) members.set((context.runs?.runs ?? []).filter((run) => run.sweep === of));
      },
      destroy() {},
    };
  },
};
