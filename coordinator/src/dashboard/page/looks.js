// Asks before test clouds are shown, because that is recorded as a look.
import { h } from './dom.js';

// Runs whose test clouds the reader has agreed to see, since the page was loaded.
const agreed = new Set();

/** Whether the reader has agreed to see the test clouds of the run. */
export function mayLook(run) {
  return agreed.has(run);
}

/** A box that asks, hidden at first; `run()` gives the run, `onAgree()` is called when the reader agrees. */
export function createConsent(run, onAgree) {
  const agree = () => {
    agreed.add(run());
    onAgree();
  };
  return h(
    'div',
    { class: 'consent', hidden: true },
    h(
      'p',
      null,
      'This is a test cloud. Showing test clouds is recorded as a look in the table “looks” of the run: whoever measures often enough on them finds something good by chance.',
    ),
    h('button', { class: 'primary', onclick: agree }, 'Show test clouds and record it'),
  );
}
