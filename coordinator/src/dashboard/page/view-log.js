// What was worth telling: events with their levels, linked to the lanes of their workers.

import { passingWorkers } from './brush.js';
import { h, replace, setText } from './dom.js';
import { count, moment, plural } from './format.js';
import { createTable } from './table.js';

const LEVELS = { error: '✕ error', warning: '▲ warning', info: '· info' };
/** What of the timeline is shown about an event, in milliseconds. */
const AROUND = 15_000;
const NAMES = Object.keys(LEVELS);

export const view = {
  id: 'log',
  title: 'Log',
  create(root, context) {
    const { store, state } = context;
    const summary = h('p', { class: 'muted', role: 'status' });
    const search = h('input', {
      type: 'search',
      value: state.get('lfind') ?? '',
      oninput: () => state.set({ lfind: search.value }),
    });
    const shown = () => (state.get('levels') ?? NAMES.join(',')).split(',').filter((name) => LEVELS[name]);
    const boxes = new Map();
    const toggle = () => {
      const on = NAMES.filter((name) => boxes.get(name).checked);
      state.set({ levels: on.length === NAMES.length ? null : on.join(',') || 'none' });
    };
    for (const name of NAMES) boxes.set(name, h('input', { type: 'checkbox', onchange: toggle }));
    const clear = h('button', { class: 'small', hidden: true, onclick: () => state.set({ worker: null }) });

    const table = createTable({
      caption: 'Events',
      key: (event) => event.sequence,
      page: 100,
      sort: 'at:descending',
      getSort: () => state.get('sort'),
      setSort: (sort) => state.set({ sort }),
      empty: 'No event matches. Losses, differing answers, rewinds and commands would stand here.',
      columns: [
        {
          id: 'at',
          title: 'When',
          value: (event) => event.at_ms + event.sequence / 1e9,
          text: (event) => moment(event.at_ms),
        },
        {
          id: 'level',
          title: 'Level',
          value: (event) => -NAMES.indexOf(event.level),
          node: (event) => h('span', { class: `badge ${event.level}` }, LEVELS[event.level] ?? event.level),
        },
        { id: 'event', title: 'Event', header: true, value: (event) => event.event },
        {
          id: 'worker',
          title: 'Worker',
          value: (event) => event.worker,
          node: (event) =>
            event.worker === null
              ? ''
              : h(
                  'a',
                  {
                    href: state.link({
                      view: 'timeline',
                      worker: event.worker,
                      t: `${event.at_ms - AROUND}..${event.at_ms + AROUND}`,
                    }),
                    title: 'its lane in the timeline',
                  },
                  event.worker,
                ),
        },
        { id: 'generation', title: 'Generation', number: true, value: (event) => event.generation },
        {
          id: 'message',
          title: 'Message',
          value: (event) => event.message,
          node: (event) => h('div', { class: 'message' }, event.message),
        },
      ],
    });
    replace(
      root,
      h(
        'section',
        { class: 'panel' },
        h('h2', null, 'Log'),
        h(
          'div',
          { class: 'row' },
          h('label', { class: 'field' }, 'Find', search),
          NAMES.map((name) => h('label', { class: 'inline' }, boxes.get(name), LEVELS[name])),
          clear,
        ),
        summary,
        table.element,
      ),
    );

    return {
      update(changed) {
        const levels = new Set(shown());
        for (const [name, box] of boxes) box.checked = levels.has(name);
        const worker = state.get('worker');
        clear.hidden = worker === null;
        setText(clear, `Only ${worker} ✕`);
        if (!['events', 'state', 'filter'].some((name) => changed.has(name))) return;
        const words = (state.get('lfind') ?? '').toLowerCase().split(/\s+/).filter(Boolean);
        const passing = passingWorkers(store);
        const events = (store.events ?? []).filter((event) => {
          if (!levels.has(event.level) || (worker !== null && event.worker !== worker)) return false;
          if (passing !== null && event.worker !== null && !passing.has(event.worker)) return false;
          const text = `${event.event} ${event.worker ?? ''} ${event.message}`.toLowerCase();
          return words.every((word) => text.includes(word));
        });
        const all = store.events ?? [];
        const of = (name) => all.filter(({ level }) => level === name).length;
        setText(
          summary,
          `${plural(all.length, 'event')}: ${plural(of('error'), 'error')}, ${plural(of('warning'), 'warning')}, ${count(of('info'))} of information; ${count(events.length)} shown.`,
        );
        table.set(events);
      },
      destroy() {},
    };
  },
};
