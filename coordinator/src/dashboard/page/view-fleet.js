// The workers: what they do, how busy they are, why they left; draining and denying them.

import { passingWorkers } from './brush.js';
import { giveCommand, refusal } from './command.js';
import { choice, h, replace, setText } from './dom.js';
import { count, duration, moment, percent, plural } from './format.js';
import { createTable } from './table.js';

const STATES = { busy: '▶ busy', idle: '○ idle', draining: '◐ draining', gone: '✕ gone' };
const ORDER = Object.keys(STATES);
const COMMANDS = {
  drain: {
    verb: 'Drain',
    text: 'It gets no more jobs and ends those it has. It stays connected, and can be given jobs again.',
    button: 'Drain it',
  },
  resume: { verb: 'Give jobs to', text: 'It is drained no more: it gets jobs again.', button: 'Give it jobs' },
  deny: {
    verb: 'Deny',
    text: 'It is removed, its jobs go to others, and it is let in no more. What it had handed in before remains.',
    button: 'Deny it',
    danger: true,
  },
};

const oldest = (worker) =>
  worker.leases?.reduce(
    (most, { age_seconds: age }) => (age !== null && (most === null || age > most) ? age : most),
    null,
  ) ?? null;

/** How long the jobs of each worker ran on average, as name -> seconds. */
function meanSeconds(attempts) {
  const sums = new Map();
  for (let row = 0; row < (attempts?.rows ?? 0); row++) {
    const seconds = attempts.columns.run_seconds[row];
    if (seconds === null) continue;
    const name = attempts.columns.worker[row];
    const [sum, jobs] = sums.get(name) ?? [0, 0];
    sums.set(name, [sum + seconds, jobs + 1]);
  }
  return new Map([...sums].map(([name, [sum, jobs]]) => [name, sum / jobs]));
}

function leaseText(worker) {
  if (worker.leases === null || worker.leases.length === 0) return '';
  const age = oldest(worker);
  return age === null
    ? plural(worker.leases.length, 'job')
    : `${plural(worker.leases.length, 'job')}, oldest ${duration(age)}`;
}

export const view = {
  id: 'fleet',
  title: 'Fleet',
  create(root, context) {
    const { store, state } = context;
    const summary = h('p', { role: 'status' });
    const refused = h('p', { class: 'muted' });
    const search = h('input', {
      type: 'search',
      value: state.get('wfind') ?? '',
      oninput: () => state.set({ wfind: search.value }),
    });
    const tools = h('div', { class: 'row' });
    let passing = null;
    let ran = new Map();
    let mayControl = false;

    function command(worker, action) {
      const { verb, text, button, danger } = COMMANDS[action];
      giveCommand(context, {
        title: `${verb} ${worker.worker}`,
        text,
        button,
        danger,
        body: { action, worker: worker.worker },
      });
    }

    function actions(worker) {
      if (worker.state === 'gone') return null;
      const button = (action, title) =>
        h(
          'button',
          {
            class: action === 'deny' ? 'small danger' : 'small',
            disabled: !mayControl,
            'aria-label': `${title} ${worker.worker}`,
            onclick: () => command(worker, action),
          },
          title,
        );
      const first = worker.state === 'draining' ? button('resume', 'Give jobs') : button('drain', 'Drain');
      return h('div', { class: 'actions' }, first, button('deny', 'Deny'));
    }

    const busy = (worker) => {
      const share = worker.busy_share;
      if (share === null || share === undefined) return '–';
      return [
        h(
          'span',
          { class: 'share', 'aria-hidden': 'true' },
          h('span', { style: { width: `${Math.round(share * 100)}%` } }),
        ),
        percent(share, 0),
      ];
    };

    const table = createTable({
      caption: 'Workers',
      key: (worker) => `${worker.worker} ${worker.joined_ms}`,
      signature: (worker) => `${worker.state} ${Math.round((worker.busy_share ?? -1) * 100)} ${mayControl}`,
      page: 50,
      sort: 'state:ascending',
      getSort: () => state.get('sort'),
      setSort: (sort) => state.set({ sort }),
      rowClass: (worker) => (worker.state === 'gone' ? 'gone' : ''),
      empty: 'No worker matches.',
      columns: [
        {
          id: 'worker',
          title: 'Worker',
          header: true,
          value: (worker) => worker.worker,
          node: (worker) =>
            h(
              'a',
              { href: state.link({ view: 'timeline', worker: worker.worker }), title: 'its lane in the timeline' },
              worker.worker,
            ),
        },
        {
          id: 'state',
          title: 'State',
          value: (worker) => ORDER.indexOf(worker.state),
          text: (worker) => STATES[worker.state] ?? worker.state,
        },
        { id: 'threads', title: 'Threads', number: true, value: (worker) => worker.threads },
        {
          id: 'busy',
          title: 'Busy',
          value: (worker) => worker.busy_share,
          hint: 'share of its time in which its threads evaluated',
          node: busy,
        },
        {
          id: 'leases',
          title: 'In hand',
          value: oldest,
          text: leaseText,
          hint: 'jobs it has now, and since when the oldest',
        },
        {
          id: 'answers',
          title: 'Answers',
          number: true,
          value: (worker) => worker.answers,
          text: (worker) => count(worker.answers),
        },
        {
          id: 'ran',
          title: 'Time a job',
          number: true,
          value: (worker) => ran.get(worker.worker) ?? null,
          text: (worker) => duration(ran.get(worker.worker)),
          hint: 'mean time that its jobs ran: a slow machine has a long one',
        },
        {
          id: 'brushed',
          title: 'Brushed',
          number: true,
          value: (worker) => passing?.get(worker.worker) ?? null,
          text: (worker) => (passing ? count(passing.get(worker.worker) ?? 0) : ''),
          hint: 'individuals of the brush that it computed',
        },
        {
          id: 'joined',
          title: 'Joined',
          value: (worker) => worker.joined_ms,
          text: (worker) => moment(worker.joined_ms),
        },
        {
          id: 'gone',
          title: 'Went',
          value: (worker) => worker.gone_ms,
          text: (worker) => (worker.gone_ms === null ? '' : moment(worker.gone_ms)),
        },
        {
          id: 'departure',
          title: 'Why it left',
          value: (worker) => worker.departure,
          text: (worker) => worker.departure ?? '',
        },
        { id: 'actions', title: 'Commands', sortable: false, value: () => null, node: actions },
        { id: 'principal', title: 'Who answers for it', value: (worker) => worker.principal },
        { id: 'build', title: 'Build', value: (worker) => worker.build },
      ],
    });
    replace(root, h('section', { class: 'panel' }, h('h2', null, 'Fleet'), summary, tools, refused, table.element));
    let drawnTools = null;

    function drawTools() {
      const wanted = state.get('wstate') ?? '';
      if (drawnTools === wanted) return;
      drawnTools = wanted;
      replace(
        tools,
        h('label', { class: 'field' }, 'Find', search),
        choice('State', [['', 'any'], ...ORDER.map((name) => [name, name])], wanted, (value) =>
          state.set({ wstate: value }),
        ),
      );
    }

    function rows() {
      const words = (state.get('wfind') ?? '').toLowerCase().split(/\s+/).filter(Boolean);
      const wanted = state.get('wstate');
      return store.fleet.workers.filter((worker) => {
        if (wanted && worker.state !== wanted) return false;
        if (passing !== null && !passing.has(worker.worker)) return false;
        const text =
          `${worker.worker} ${worker.principal ?? ''} ${worker.build} ${worker.departure ?? ''}`.toLowerCase();
        return words.every((word) => text.includes(word));
      });
    }

    return {
      update(changed) {
        drawTools();
        const why = refusal(context);
        mayControl = why === null;
        setText(refused, why ?? '');
        if (changed.has('attempts')) ran = meanSeconds(store.attempts);
        if (store.fleet === null) {
          setText(summary, 'Waiting for the fleet …');
          return;
        }
        if (changed.has('filter') || changed.has('individuals')) passing = passingWorkers(store);
        const present = store.fleet.workers.filter((worker) => worker.state !== 'gone');
        const threads = present.reduce((sum, worker) => sum + worker.threads, 0);
        const busyNow = present.filter((worker) => worker.state === 'busy').length;
        const lost = store.fleet.workers.filter((worker) => worker.departure === 'lost').length;
        setText(
          summary,
          `${store.fleet.live ? '' : 'Nobody works on this run now. '}${plural(present.length, 'worker')} present with ${plural(threads, 'thread')}, ${count(busyNow)} busy; ${count(store.fleet.workers.length - present.length)} gone, ${count(lost)} of them lost.`,
        );
        table.set(rows());
      },
      destroy() {},
    };
  },
};
