// The page: reads the address, keeps the stream of the run on show, mounts the view and tells it what has changed.

import { createApi } from './api.js';
import { brushPredicate, parseBrush } from './brush.js';
import { h, replace, setText } from './dom.js';
import { clock } from './format.js';
import { createRunHeader } from './run-header.js';
import { createState } from './state.js';
import { createStore } from './store.js';
import { openStream } from './stream.js';
import { createTheme } from './theme.js';

/** Between two updates of a view by the stream; what the reader does is shown at once. */
const PAUSE = 250;
const DETAIL_PAUSE = 10_000;
const OF_THE_READER = new Set(['state', 'filter']);

/** The views of a run in the order of the tabs. Loaded when they are first shown. */
const VIEWS = [
  { id: 'overview', title: 'Overview', load: () => import('./view-overview.js') },
  { id: 'convergence', title: 'Convergence', load: () => import('./view-convergence.js') },
  { id: 'population', title: 'Population', load: () => import('./view-population.js') },
  { id: 'answers', title: 'Wrong answers', load: () => import('./view-answers.js') },
  { id: 'descriptor', title: 'Descriptor', load: () => import('./view-descriptor.js') },
  { id: 'fleet', title: 'Fleet', load: () => import('./view-fleet.js') },
  { id: 'timeline', title: 'Timeline', load: () => import('./view-timeline.js') },
  { id: 'log', title: 'Log', load: () => import('./view-log.js') },
  { id: 'control', title: 'Control', load: () => import('./view-control.js') },
];
const RUNS = { id: 'runs', title: 'Runs', load: () => import('./view-runs.js') };
const EVERYTHING = [
  'run',
  'detail',
  'generations',
  'individuals',
  'attempts',
  'events',
  'fleet',
  'runs',
  'filter',
  'state',
];

const element = (id) => document.getElementById(id);
const content = element('content');
const changed = new Set();
let timer = 0;
let lastUpdate = 0;
let mounted = { key: null, handle: null };
let shown = { run: null, stream: null, brush: null };
let detailAt = 0;
let detailFor = '';

const api = createApi(element('login'));
const store = createStore(announce);
const state = createState(() => {
  announce('state');
  route();
});
const context = {
  store,
  state,
  api,
  /** The answer of /api/runs, null until it is there. */
  runs: null,
  /** Another view of the same run. */
  navigate: (view, values = {}) => state.set({ view, ...values }, true),
};
const header = createRunHeader(element('run-header'), VIEWS, context);

function announce(name) {
  changed.add(name);
  if (document.hidden) return;
  const wait = OF_THE_READER.has(name) ? 0 : Math.max(0, lastUpdate + PAUSE - performance.now());
  if (timer !== 0 && wait > 0) return;
  clearTimeout(timer);
  timer = setTimeout(flush, wait);
}

function flush() {
  timer = 0;
  if (document.hidden || changed.size === 0) return;
  lastUpdate = performance.now();
  const now = new Set(changed);
  changed.clear();
  if (now.has('run') || now.has('generations')) refreshDetail();
  try {
    header.update(now);
    mounted.handle?.update(now);
  } catch (error) {
    report(error);
  }
}

function report(error) {
  console.error(error);
  banner('error', `This view failed: ${error.message}. Reload the page; the run itself is not affected.`);
}

document.addEventListener('visibilitychange', flush);

let bannerKind = null;
function banner(kind, text) {
  const box = element('banner');
  bannerKind = text === null ? null : kind;
  box.hidden = text === null;
  box.className = `banner ${kind}`;
  setText(box, text ?? '');
}

let lostAt = null;
function connection(now) {
  const names = { connecting: 'connecting', open: 'connected', lost: 'connection lost' };
  const box = element('connection');
  box.className = `connection ${now}`;
  setText(box, names[now]);
  if (now === 'lost') {
    lostAt ??= Date.now();
    banner(
      'lost',
      `No connection to the coordinator since ${clock(lostAt)}. What you see is as it was then; it goes on by itself when the coordinator is back.`,
    );
  } else if (now === 'open') {
    lostAt = null;
    if (bannerKind !== null) banner(bannerKind, null);
  }
}

const probe = () => api.get('/api/runs', {}, AbortSignal.timeout(8000)).then(setRuns);

function setRuns(runs) {
  context.runs = runs;
  setText(element('root'), runs.root ?? '');
  announce('runs');
}

async function refreshDetail() {
  const { run } = shown;
  if (run === null || store.run === null) return;
  const key = `${run} ${store.run.state} ${store.run.test_error}`;
  const due = store.detail === null || key !== detailFor || performance.now() - detailAt > DETAIL_PAUSE;
  if (!due) return;
  detailFor = key;
  detailAt = performance.now();
  try {
    const detail = await api.get('/api/run', { id: run });
    if (shown.run === run) store.put('detail', detail);
    await probe();
  } catch (error) {
    detailFor = '';
    if (error.status !== 0 && shown.run === run) banner('error', error.message);
  }
}

/** The server has no stream of the run: it says why where the run itself is asked for. */
async function refused(run) {
  connection('connecting');
  try {
    await api.get('/api/run', { id: run });
    banner('error', `${run}: the server does not stream this run. Reload the page.`);
  } catch (error) {
    if (error.status !== 0 && shown.run === run) banner('error', error.message);
  }
}

function openRunStream(run) {
  const begin = () => {
    store.reset();
    detailFor = '';
  };
  return openStream({
    address: () => api.address('/api/stream', { id: run, ...store.position() }),
    probe,
    onconnection: connection,
    onrefused: () => refused(run),
    handlers: {
      run: (value) => store.put('run', value),
      generations: (table) => store.add('generations', table),
      individuals: (table) => store.add('individuals', table),
      attempts: (table) => store.add('attempts', table),
      events: (events) => store.addEvents(events),
      fleet: (fleet) => store.put('fleet', fleet),
      reload() {
        begin();
        shown.stream.restart();
      },
    },
  });
}

function openRunsStream() {
  return openStream({
    address: () => '/api/stream',
    probe,
    onconnection: connection,
    onrefused: () => banner('error', 'The server does not stream its runs. Reload the page.'),
    handlers: { runs: setRuns },
  });
}

function showRun(run) {
  shown.stream?.close();
  if (bannerKind === 'error') banner('error', null);
  store.reset();
  store.setFilter('brush', null);
  shown = { run, stream: null, brush: null };
  detailFor = '';
  shown.stream = run === null ? openRunsStream() : openRunStream(run);
}

function applyBrush() {
  const text = state.get('brush');
  if (text === shown.brush) return;
  shown.brush = text;
  store.setFilter('brush', brushPredicate(store, parseBrush(text)));
}

async function mount(view, key) {
  mounted.handle?.destroy();
  mounted = { key, handle: null };
  replace(content, h('p', { class: 'muted' }, 'Loading …'));
  document.body.dataset.view = view.id;
  try {
    const module = await view.load();
    if (mounted.key !== key) return;
    replace(content);
    mounted.handle = module.view.create(content, context);
    mounted.handle.update(new Set(EVERYTHING));
  } catch (error) {
    if (mounted.key !== key) return;
    replace(
      content,
      h('p', { class: 'problem', role: 'alert' }, `${view.title}: this view cannot be shown: ${error.message}`),
    );
    console.error(error);
  }
}

function route() {
  const run = state.get('run');
  if (run !== shown.run || shown.stream === null) showRun(run);
  applyBrush();
  const view = run === null ? RUNS : (VIEWS.find(({ id }) => id === state.get('view')) ?? VIEWS[0]);
  document.title = run === null ? 'Runs – Descry' : `${run} – ${view.title} – Descry`;
  header.route(run, view.id);
  const key = `${run} ${view.id}`;
  if (mounted.key !== key) mount(view, key);
}

createTheme(element('theme'), () => announce('state'));
element('skip').addEventListener('click', (event) => {
  event.preventDefault();
  content.focus();
});
route();
