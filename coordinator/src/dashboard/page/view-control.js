// Commands for the run: pause, resume, stop, and the priorities of a sweep's members, each with a reason.

import { giveCommand, refusal } from './command.js';
import { h, replace, setText } from './dom.js';
import { duration, percent } from './format.js';
import { generationText, stateBadge } from './run-header.js';
import { createTable } from './table.js';

const ACTIVE = new Set(['running', 'paused']);
const COMMANDS = [
  {
    action: 'pause',
    button: 'Pause',
    text: 'No more jobs are handed out; those in hand end, and their results count. Workers stay and wait.',
    allowed: (run) => run.state === 'running',
  },
  { action: 'resume', button: 'Resume', text: 'Jobs are handed out again.', allowed: (run) => run.state === 'paused' },
  {
    action: 'stop',
    button: 'Stop',
    danger: true,
    text: 'The coordinator ends, as by Ctrl-C. Nothing that was computed is lost: coordinator resume goes on from here.',
    allowed: (run) => ACTIVE.has(run.state),
  },
];
const OF_A_SWEEP = ' The runs of a sweep share one coordinator: this is for all of them.';

export const view = {
  id: 'control',
  title: 'Control',
  create(root, context) {
    const { store } = context;
    const why = h('p', { role: 'status' });
    const rows = COMMANDS.map((command) => {
      const button = h(
        'button',
        { class: command.danger ? 'danger' : 'primary', onclick: () => give(command) },
        command.button,
      );
      return { command, button, element: h('div', null, h('dt', null, button), h('dd', null, command.text)) };
    });
    const order = ({ action, button, text, danger }, id) =>
      giveCommand(context, {
        title: `${button} ${id}`,
        text: id === store.run.sweep ? `${text}${OF_A_SWEEP}` : text,
        button,
        danger,
        body: { action, id },
      });
    /** Only a sweep as a whole can be stopped. */
    const give = (command) => order(command, (command.action === 'stop' && store.run.sweep) || store.run.id);
    const ofSweep = COMMANDS.slice(0, 2).map((command) =>
      h('button', { onclick: () => order(command, store.run.sweep) }, `${command.button} the sweep`),
    );

    const priority = h('input', { type: 'number', step: 1, min: 1, max: 100, value: 1 });
    const setPriority = h(
      'button',
      {
        onclick() {
          if (!priority.reportValidity()) return;
          const value = Number(priority.value);
          giveCommand(context, {
            title: `Priority ${value} for ${store.run.id}`,
            text: `While it has jobs that wait, it gets ${value} times as much of the workers as a run of priority 1. The others never stand still.`,
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
        {
          id: 'id',
          title: 'Member',
          header: true,
          value: (run) => run.member ?? run.id,
          node: (run) =>
            h('a', { href: context.state.link({ run: run.id, view: 'control' }, false) }, run.member ?? run.id),
        },
        { id: 'state', title: 'State', value: (run) => run.state, node: (run) => stateBadge(run.state) },
        { id: 'generation', title: 'Generation', number: true, value: (run) => run.generation, text: generationText },
        {
          id: 'best',
          title: 'Training error',
          number: true,
          value: (run) => run.best_error,
          text: (run) => percent(run.best_error),
        },
        {
          id: 'left',
          title: 'Time left',
          number: true,
          value: (run) => run.seconds_left,
          text: (run) => duration(run.seconds_left),
        },
      ],
    });
    const sweep = h(
      'section',
      { class: 'panel', hidden: true },
      h('h2', null, 'Sweep'),
      h(
        'p',
        null,
        'This run is one of a sweep, whose runs share the workers equally unless one has a higher priority.',
      ),
      h(
        'div',
        { class: 'row' },
        h('label', { class: 'field' }, 'Priority of this run, 1 to 100', priority),
        setPriority,
        ofSweep,
      ),
      members.element,
    );
    replace(
      root,
      h(
        'section',
        { class: 'panel' },
        h('h2', null, 'Control'),
        why,
        h(
          'dl',
          { class: 'commands' },
          rows.map(({ element }) => element),
        ),
        h(
          'p',
          { class: 'muted' },
          'Workers are drained and denied in the fleet. Whatever is ordered, results stay the same; each order becomes an event in the log.',
        ),
      ),
      sweep,
    );

    return {
      update() {
        const refused = refusal(context);
        setText(why, refused ?? '');
        for (const { command, button } of rows) button.disabled = refused !== null || !command.allowed(store.run);
        for (const button of [setPriority, ...ofSweep]) button.disabled = refused !== null;
        const of = store.run?.sweep ?? null;
        sweep.hidden = of === null;
        if (of !== null) members.set((context.runs?.runs ?? []).filter((run) => run.sweep === of));
      },
      destroy() {},
    };
  },
};
