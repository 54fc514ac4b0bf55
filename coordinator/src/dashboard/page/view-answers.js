// The view of wrong answers: what is taken for what, and the clouds of each wrong answer in 3D.
import { inScope, isPicked, pairsOf, readAnswers, byName } from './answers.js';
import { createCloudCache } from './cloud-cache.js';
import { createConfusion } from './confusion.js';
import { h } from './dom.js';
import { percent } from './format.js';
import { createConsent, mayLook } from './looks.js';
import { createTriple } from './triple.js';
import { createWrongList } from './wrong-list.js';

const COMPARED = 'compared:';

export const view = { id: 'answers', title: 'Wrong answers', create };

function create(root, context) {
  const { state, store, api } = context;
  const stop = new AbortController();
  const load = createCloudCache(api);
  const run = () => store.run?.id ?? null;
  // The page tells of a new state a little later; the list moves its focus at once.
  const set = (values) => {
    state.set(values);
    refresh();
  };

  const of = select('Answers of', (value) => set({ of: value, query: null, object: null, taken: null }));
  const object = select('Object', (value) => set({ object: value, taken: null, query: null }));
  const category = select('Category', (value) => set({ category: value, object: null, taken: null, query: null }));
  const text = h('input', {
    type: 'search',
    placeholder: 'cloud or object',
    oninput: (event) => set({ text: event.target.value, query: null }),
  });
  const clear = h(
    'button',
    { onclick: () => set({ object: null, taken: null, category: null, text: null, query: null }) },
    'Show all',
  );
  const filters = h(
    'div',
    { class: 'row' },
    of.element,
    category.element,
    object.element,
    h('label', { class: 'field' }, 'Text', text),
    clear,
  );
  const summary = h('p', { class: 'answers-summary', role: 'status' });
  const notice = h('div');

  const by = ['object', 'category'].map((kind) => {
    const words = kind === 'object' ? 'Objects' : 'Categories';
    const press = () => set({ matrix: kind === 'object' ? null : kind, object: null, taken: null, query: null });
    return h('button', { class: 'small', 'data-by': kind, onclick: press }, words);
  });
  const confusion = createConfusion((own, other) => {
    const again = state.get('object') === own && state.get('taken') === other;
    set({ object: again ? null : own, taken: again ? null : other, query: null });
  });
  const list = createWrongList({
    onSelect: (row) => set({ query: row.cloud }),
    onOpen(row) {
      set({ query: row.cloud });
      open();
    },
  });
  const explain = (row) => {
    const { generation, individual } = searched(chosen()) ?? {};
    return explainedBy(chosen(), row, (more) => api.get('/api/explain', { id: run(), generation, individual, ...more }));
  };
  const triple = createTriple({ load: (path) => load(run(), path), explain });
  const title = h('h2', { tabindex: '-1', class: 'answer-title' });
  const place = h('span', { class: 'muted' });
  const steps = [
    h('button', { class: 'small', onclick: () => list.step(-1) }, '‹ Previous'),
    h('button', { class: 'small', onclick: () => list.step(1) }, 'Next ›'),
  ];
  const compare = h('button', { class: 'small' }, 'Histograms of query and answer');
  const consent = createConsent(run, () => {
    refresh();
    title.focus();
  });
  const key = (name) => h('kbd', null, name);
  const hint = h(
    'p',
    { class: 'muted hint' },
    key('j'),
    ' ',
    key('k'),
    ' next, previous wrong answer · ',
    key('Enter'),
    ' to its clouds · ',
    key('Esc'),
    ' back to the list',
  );
  const detail = h(
    'section',
    { class: 'panel answer-detail' },
    h('div', { class: 'row' }, title, place, steps, compare),
    consent,
    triple.element,
  );
  const matrix = h(
    'section',
    { class: 'panel' },
    h('div', { class: 'row' }, h('h2', null, 'Confusion'), by),
    confusion.element,
  );
  const wrongPanel = h('section', { class: 'panel' }, h('h2', null, 'Wrong answers'), hint, list.element);
  const body = h('div', { class: 'answers' }, h('div', { class: 'answers-side' }, matrix, wrongPanel), detail);
  root.append(h('section', { class: 'panel' }, filters, summary, notice), body);

  let data = { key: null, rows: [], problem: null };
  let pairs = [];
  let drawn = '';
  let shown = null;

  function refresh() {
    fetchAnswers();
    show();
  }

  function choices() {
    return store.detail?.answers ?? [];
  }

  function chosen() {
    const wanted = state.get('of');
    return choices().includes(wanted) ? wanted : (choices()[0] ?? null);
  }

  /** The individual that gave answers on validation clouds: the winner before its values were weighed. */
  function searched(what) {
    const detail = what === 'validation' ? store.detail : null;
    return detail?.errors.some(({ split }) => split === 'train weighed') ? detail.winner : null;
  }

  async function fetchAnswers() {
    const what = chosen();
    const key = JSON.stringify([run(), what, store.detail?.winner ?? null]);
    if (what === null || data.key === key) return;
    data = { key, rows: [], problem: data.problem, loading: true };
    drawn = '';
    try {
      const rows = readAnswers(await api.get('/api/answers', { id: run(), of: what }));
      if (data.key !== key) return;
      data = { key, rows, problem: null };
    } catch (error) {
      if (data.key !== key) return;
      // Without a key: it is asked for again as soon as there is news of the run.
      data = { key: null, rows: [], problem: error.message };
    }
    drawn = '';
    if (!stop.signal.aborted) show();
  }

  function show() {
    const what = chosen();
    const filter = { category: state.get('category'), find: state.get('text') };
    const kind = state.get('matrix') === 'category' ? 'category' : 'object';
    const picked = { object: state.get('object'), as: state.get('taken'), by: kind };
    const query = state.get('query');
    const now = JSON.stringify([data.key, filter, picked, choices(), store.detail?.test_clouds]);
    tell(what);
    body.hidden = data.rows.length === 0;
    if (now !== drawn) {
      drawn = now;
      const scope = data.rows.filter((row) => inScope(row, filter));
      const wrong = scope.filter((row) => row.wrong);
      pairs = pairsOf(
        wrong.filter((row) => isPicked(row, picked)),
        data.rows,
      );
      const names = (get) => [...new Set(data.rows.map(get))].sort(byName);
      of.fill(
        choices().map((choice) => [choice, nameOf(choice)]),
        what,
      );
      category.fill([['', 'all'], ...names((row) => row.category).map((name) => [name, name])], filter.category);
      const errors = (name) =>
        wrong.filter((row) => (kind === 'category' ? row.category : row.instance) === name).length;
      const objects = names(kind === 'category' ? (row) => row.category : (row) => row.instance);
      object.fill(
        [['', 'all'], ...objects.filter(errors).map((name) => [name, `${name} (${errors(name)} wrong)`])],
        picked.object,
      );
      object.rename(kind === 'category' ? 'Category of the cloud' : 'Object');
      by.forEach((button) => button.setAttribute('aria-pressed', String(button.dataset.by === kind)));
      confusion.show(scope, kind, picked);
      clear.disabled = !(filter.category || filter.find || picked.object);
    }
    if (document.activeElement !== text) text.value = filter.find ?? '';
    const rows = pairs.flatMap((pair) => pair.rows);
    const row = rows.find(({ cloud }) => cloud === query) ?? rows[0] ?? null;
    list.show(pairs, row?.cloud ?? null);
    showAnswer(row, what);
  }

  function showAnswer(row, what) {
    title.textContent = row ? `${row.instance} taken for ${row.predicted}` : 'No wrong answer here';
    const [at, all] = list.position();
    place.textContent = row ? `${at + 1} of ${all} wrong` : '';
    compare.hidden = row === null;
    const by = searched(what);
    const selected = by ? `${by.generation}.${by.individual}` : null;
    compare.onclick = () => context.navigate('descriptor', { first: row.cloud, second: row.nearest, selected });
    steps[0].disabled = at <= 0;
    steps[1].disabled = at >= all - 1;
    const ask = row !== null && what !== 'validation' && !mayLook(run());
    consent.hidden = !ask;
    triple.element.hidden = row === null || ask;
    if (row === null || ask) return;
    const key = `${data.key} ${row.cloud}`;
    if (shown === key) return;
    shown = key;
    triple.show(row).then((fine) => {
      if (!fine && shown === key) shown = null;
    });
  }

  function tell(what) {
    const { detail: known } = store;
    const rows = data.rows;
    const wrong = rows.filter((row) => row.wrong).length;
    const wrongCategory = rows.filter((row) => row.wrongCategory).length;
    const share = (part) => percent(part / rows.length);
    summary.textContent = rows.length
      ? `${wrong} of ${rows.length} clouds have a wrong object (${share(wrong)}), ${wrongCategory} a wrong category (${share(wrongCategory)}).`
      : known === null || data.loading
        ? 'Loading …'
        : '';
    const lines = [];
    if (data.problem) lines.push(h('p', { class: 'problem', role: 'alert' }, data.problem));
    if (known && what === null)
      lines.push(h('p', { class: 'notice' }, 'There are no answers yet: they are written when the search has ended.'));
    if (known?.test_clouds === 'hidden until the search ends') {
      lines.push(
        h(
          'p',
          { class: 'notice' },
          'Test clouds are hidden until the search ends, lest the search is steered by them. Their answers follow then.',
        ),
      );
    } else if (known?.test_clouds === 'shown' && what !== null && what !== 'validation') {
      lines.push(h('p', { class: 'notice' }, 'These are test clouds. That they are shown is recorded as a look.'));
    }
    const said = lines.map((line) => line.textContent).join('\n');
    if (notice.dataset.said !== said) notice.replaceChildren(...lines);
    notice.dataset.said = said;
  }

  function open() {
    title.focus({ preventScroll: true });
    const box = detail.getBoundingClientRect();
    if (box.top < 0 || box.top > innerHeight * 0.6) detail.scrollIntoView({ block: 'start' });
  }

  function back() {
    list.reveal(true);
    const box = list.element.getBoundingClientRect();
    if (box.bottom < 40 || box.top > innerHeight - 40) list.element.scrollIntoView({ block: 'nearest' });
  }

  document.addEventListener(
    'keydown',
    (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
      if (event.target.closest('input, select, textarea, dialog[open]') || body.hidden) return;
      const inside = event.target === document.body || root.contains(event.target);
      const keys = { j: () => list.step(1), k: () => list.step(-1), Escape: back };
      const act = event.key === 'Enter' && event.target === document.body ? open : keys[event.key];
      if (!inside || !act) return;
      event.preventDefault();
      act();
    },
    { signal: stop.signal },
  );

  return {
    update(changed) {
      if (['run', 'detail', 'state'].some((name) => changed.has(name))) refresh();
    },
    destroy() {
      stop.abort();
      triple.dispose();
    },
  };
}

/** How the distances of a row come about: by the channels of the descriptor that answered, where they can be known. */
async function explainedBy(what, row, ask) {
  const clouds = { query: row.cloud, answer: row.nearest };
  if (!what.startsWith(COMPARED)) return ask(clouds);
  const compared = what.slice(COMPARED.length);
  try {
    const told = await ask({ ...clouds, compared });
    const isSame = Math.abs(told.answer_distance - row.distance) <= 1e-9 * Math.max(1, Math.abs(row.distance));
    const other = `${compared} answered by another distance than its own: what follows is by its own, and need not decide as the answer did.`;
    return { ...told, note: isSame ? null : other };
  } catch (error) {
    if (error.status !== 404) throw error;
    const [why] = error.message.split('\n');
    const note = `${why}. The right cloud and the channels below are of the winner, for the same two clouds.`;
    return { ...(await ask(clouds)), note };
  }
}

function nameOf(choice) {
  if (choice.startsWith(COMPARED)) return `${choice.slice(COMPARED.length)} (test clouds)`;
  return { validation: 'winner on validation clouds', test: 'winner on test clouds' }[choice] ?? choice;
}

/** A select whose choices `[value, text]` may be exchanged; `onChange` gets null for an empty value. */
function select(label, onChange) {
  const list = h('select', { onchange: (event) => onChange(event.target.value || null) });
  const name = new Text(label);
  let known = '';
  return {
    element: h('label', { class: 'field' }, name, list),
    rename: (text) => (name.data = text),
    fill(choices, value) {
      const now = JSON.stringify(choices);
      if (now !== known) list.replaceChildren(...choices.map(([key, text]) => h('option', { value: key }, text)));
      known = now;
      list.value = value ?? '';
    },
  };
}
