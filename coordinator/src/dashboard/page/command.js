// Asks for the reason of a command, sends it, and says what came of it.

import { h, replace } from './dom.js';

/** Whether this page may control the run, or why not, as a sentence. */
export function refusal(context) {
  const { run, fleet } = context.store;
  if (context.runs === null || run === null) return 'Waiting for the run.';
  if (!context.runs.may_control) return 'This dashboard only shows: start it with control allowed to give commands.';
  if (run.state !== 'running' && run.state !== 'paused') return `The run is ${run.state}: there is nothing to control.`;
  if (fleet !== null && !fleet.live)
    return 'The coordinator of this run is another process: give commands on its own dashboard.';
  return null;
}

/**
 * Shows a dialog that asks for a reason and sends the command.
 * @param {object} context of the page
 * @param {{title: string, text: string, button: string, danger?: boolean, body: object}} command `body` may name another
 *   `id` than that of the run on show
 */
export function giveCommand(context, { title, text, button, danger, body }) {
  const { run } = context.store;
  const reason = h('input', {
    type: 'text',
    name: 'reason',
    required: true,
    minlength: 1,
    maxlength: 200,
    autocomplete: 'off',
  });
  const answer = h('p', { role: 'alert', class: 'problem' });
  const send = h('button', { class: danger ? 'danger' : 'primary' }, button);
  const close = h('button', { type: 'button', onclick: () => dialog.close() }, 'Cancel');
  const form = h(
    'form',
    {
      async onsubmit(event) {
        event.preventDefault();
        send.disabled = true;
        try {
          const { done } = await context.api.post('/api/control', { id: run.id, ...body, reason: reason.value.trim() });
          answer.className = 'done';
          answer.textContent = done;
          close.textContent = 'Close';
          replace(buttons, close);
          close.focus();
        } catch (error) {
          answer.textContent = error.message;
          send.disabled = false;
        }
      },
    },
    h('h2', null, title),
    h('p', null, text),
    h('label', { class: 'field' }, 'Reason (recorded among the events)', reason),
    answer,
  );
  const buttons = h('div', { class: 'row' }, send, close);
  form.append(buttons);
  const dialog = h('dialog', { 'aria-label': title, onclose: () => dialog.remove() }, form);
  document.body.append(dialog);
  dialog.showModal();
  reason.focus();
}
