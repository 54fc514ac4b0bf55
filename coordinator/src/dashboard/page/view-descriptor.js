// The view of a descriptor: what its channels see of any two clouds, and how that makes their distance.
import { channelBars } from './channel-bars.js';
import { createCloudCache, shortName } from './cloud-cache.js';
import { cloudInput } from './cloud-input.js';
import { h, svg } from './dom.js';
import { histograms } from './histogram.js';
import { createConsent, mayLook } from './looks.js';
import { number } from './format.js';
import { createRegionViewer } from './regions.js';
import { link } from './viewer.js';

const STEPS = 40;
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];

export const view = { id: 'descriptor', title: 'Descriptor', create };

function create(root, context) {
  const { state, store, api } = context;
  const stop = new AbortController();
  const load = createCloudCache(api);
  const run = () => store.run?.id ?? null;
  const inputs = ['A', 'B'].map((letter, i) => cloudInput(letter, (path) => pickCloud(i, path)));
  const whole = (label, name) => {
    const input = h('input', { type: 'number', min: '0', step: '1', name, onchange: pickIndividual });
    return { input, element: h('label', { class: 'field individual' }, label, input) };
  };
  const generation = whole('Generation', 'generation');
  const individual = whole('Individual', 'individual');
  const winner = h('button', { onclick: () => set({ selected: null }) }, 'Winner');
  const swap = h('button', { onclick: () => set({ first: chosen()[1], second: chosen()[0] }) }, 'Swap A and B');
  const problem = h('p', { class: 'problem', role: 'alert', hidden: true });
  const text = h('p', { class: 'descriptor-text' });
  const consent = createConsent(run, () => {
    refresh();
    sides[0].canvas.focus();
  });
  const form = h(
    'section',
    { class: 'panel' },
    h(
      'div',
      { class: 'row' },
      inputs.map(({ element }) => element),
      swap,
    ),
    h('div', { class: 'row' }, generation.element, individual.element, winner),
    text,
    problem,
    consent,
  );

  const sides = ['A', 'B'].map((letter, i) => makeSide(letter, i));
  link(sides.map(({ viewer }) => viewer));
  const legend = h('div');
  const bars = h('div');
  const channels = h('div', { class: 'channels' });
  const keys = ['n', 'p'].map((name) => h('kbd', null, name));
  const hint = h(
    'p',
    { class: 'muted hint' },
    'Click a point to draw the regions around it; ',
    keys[0],
    ' ',
    keys[1],
    ' next, previous point. One camera for both: drag or arrow keys turn, the wheel zooms after a click. ',
    h('button', { class: 'small', onclick: () => sides[0].viewer.fit() }, 'Reset view'),
  );
  const body = h(
    'div',
    { class: 'descriptor' },
    h(
      'section',
      { class: 'panel' },
      h('h2', null, 'What it looks at'),
      h(
        'div',
        { class: 'clouds' },
        sides.map(({ element }) => element),
      ),
      hint,
      legend,
    ),
    h('section', { class: 'panel' }, h('h2', null, 'Distance of A and B'), bars),
    h(
      'section',
      { class: 'panel wide' },
      h('h2', null, 'Histograms'),
      h('p', { class: 'muted' }, 'Both clouds have the same scale; the dashed line is the other cloud.'),
      channels,
    ),
  );
  root.append(form, body);

  let clouds = { run: null, list: [], byPath: new Map() };
  let told = null;
  let asked = null;
  let trouble = null;

  function set(values) {
    state.set(values);
    refresh();
  }

  function pickCloud(i, path) {
    // The other one too: what stands for it by default depends on this one.
    const [first, second] = chosen();
    set(i === 0 ? { first: path, second } : { first, second: path });
  }

  function pickIndividual() {
    const [g, i] = [generation.input.value, individual.input.value];
    if (g !== '' && i !== '') set({ selected: `${g}.${i}` });
  }

  function fail(message) {
    problem.textContent = message ?? '';
    problem.hidden = !message;
  }

  async function fetchClouds() {
    const id = run();
    const key = `${id} ${store.detail?.test_clouds}`;
    if (id === null || clouds.run === key) return;
    clouds = { run: key, list: [], byPath: new Map() };
    try {
      const { clouds: list } = await api.get('/api/clouds', { id });
      if (clouds.run !== key) return;
      clouds = { run: key, list, byPath: new Map(list.map((cloud) => [cloud.path, cloud])) };
      inputs.forEach((input) => input.offer(list));
      refresh();
    } catch (error) {
      if (clouds.run !== key) return;
      clouds.run = null;
      fail(error.message);
    }
  }

  /** The two paths of the address, or two clouds of different objects of one category. */
  function chosen() {
    const { list } = clouds;
    const first = state.get('first') ?? (list.find(({ split }) => split === 'validation') ?? list[0])?.path ?? null;
    const own = clouds.byPath.get(first);
    const others = list.filter((cloud) => cloud.split !== 'test' && cloud.instance !== own?.instance);
    const other = others.find((cloud) => cloud.category === own?.category) ?? others[0];
    return [first, state.get('second') ?? other?.path ?? null];
  }

  function refresh() {
    fetchClouds();
    const paths = chosen();
    inputs.forEach((input, i) => input.show(paths[i]));
    const by = state.get('selected');
    const known =
      by ?? (store.detail?.winner ? `${store.detail.winner.generation}.${store.detail.winner.individual}` : '.');
    [generation.input, individual.input].forEach((input, i) => {
      if (document.activeElement !== input) input.value = known.split('.')[i] ?? '';
    });
    winner.setAttribute('aria-pressed', String(by === null));
    winner.textContent = store.detail && !store.detail.winner ? 'Best so far' : 'Winner';
    if (clouds.list.length === 0) return;
    const unknown = paths.find((path) => !clouds.byPath.has(path));
    if (unknown !== undefined) {
      const hidden = store.detail?.test_clouds === 'hidden until the search ends';
      fail(
        `cloud: no cloud of this name, got ${unknown}\n${hidden ? 'test clouds are hidden until the search ends; ' : ''}pick one of the list`,
      );
      body.hidden = true;
      return;
    }
    fail(trouble);
    const test = paths.some((path) => clouds.byPath.get(path).split === 'test');
    consent.hidden = !test || mayLook(run());
    body.hidden = !consent.hidden;
    if (!body.hidden) ask(paths, by);
  }

  async function ask(paths, by) {
    const key = JSON.stringify([run(), paths, by, by === null ? [store.detail?.winner, store.run?.best_error] : null]);
    if (asked === key) return;
    asked = key;
    sides.forEach((side, i) => side.show(paths[i]));
    const [g, i] = by === null ? [] : by.split('.');
    try {
      const answer = await api.get('/api/explain', {
        id: run(),
        query: paths[0],
        answer: paths[1],
        generation: g,
        individual: i,
      });
      if (asked !== key) return;
      told = answer;
      trouble = null;
      fail(null);
      describe(paths.map(shortName));
    } catch (error) {
      if (asked !== key) return;
      [told, asked, trouble] = [null, null, error.message];
      [bars, channels, legend].forEach((element) => element.replaceChildren());
      sides.forEach((side) => side.mark());
      text.textContent = '';
      fail(error.message);
    }
  }

  function describe(names) {
    text.textContent = `${store.detail?.winner || state.get('selected') ? '' : 'Best so far: '}${told.descriptor}`;
    const parts = told.channels.map((channel) => channel.answer_distance);
    bars.replaceChildren(channelBars(told.channels, [{ name: 'A to B', total: told.answer_distance, parts }]));
    channels.replaceChildren(
      ...told.channels.map((channel, i) => {
        const share = (100 * channel.answer_distance) / (told.answer_distance || 1);
        const title = h(
          'h3',
          null,
          h('span', { class: `key channel-${i % 7}` }),
          channel.name,
          h('small', { class: 'muted' }, ` weight ${number(channel.weight)}, ${share.toFixed(1)} % of the distance`),
        );
        return h('div', { class: 'channel' }, title, histograms(channel, names));
      }),
    );
    showLegend();
    sides.forEach((side) => side.mark());
  }

  /** Regions of all channels; channels that look at the same one share it. */
  function regions() {
    const found = new Map();
    for (const channel of told?.channels ?? []) {
      for (const { name, inner_cm, outer_cm } of channel.regions) {
        const key = `${name} ${inner_cm} ${outer_cm}`;
        if (!found.has(key)) found.set(key, { name, inner_cm, outer_cm, channels: [] });
        found.get(key).channels.push(channel.name);
      }
    }
    return [...found.values()].map((region, i) => ({
      ...region,
      colour: `--c${(i % 7) + 1}`,
      dash: DASHES[i % DASHES.length],
    }));
  }

  function showLegend() {
    const all = regions();
    const without = told.channels.filter((channel) => channel.regions.length === 0).map(({ name }) => name);
    const lines = all.map((region) => {
      const line = svg('line', {
        x1: 0,
        x2: 36,
        y1: 5,
        y2: 5,
        'stroke-width': 2.5,
        'stroke-dasharray': region.dash.join(' '),
      });
      line.style.stroke = `var(${region.colour})`;
      const sample = svg('svg', { width: 36, height: 10, 'aria-hidden': 'true' }, line);
      const cells = sides.map(({ within }) =>
        h('td', { class: 'number', 'data-region': region.name }, String(within(region))),
      );
      return h(
        'tr',
        null,
        h('th', { scope: 'row' }, sample, ` ${region.name}`),
        h('td', { class: 'number' }, `${number(region.inner_cm)} – ${number(region.outer_cm)} cm`),
        h('td', null, region.channels.join(', ')),
        cells,
      );
    });
    const heads = ['Region', 'Radius', 'Channels', 'Points, A', 'Points, B'].map((name, i) =>
      h('th', { scope: 'col', class: i === 1 || i > 2 ? 'number' : null }, name),
    );
    legend.replaceChildren(
      all.length
        ? h(
            'div',
            { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Regions' },
            h(
              'table',
              null,
              h('caption', { class: 'hidden' }, 'Regions around the picked points'),
              h('thead', null, h('tr', null, heads)),
              h('tbody', null, lines),
            ),
          )
        : '',
      without.length ? h('p', { class: 'muted' }, `${without.join(', ')}: the whole cloud, without regions.`) : '',
    );
  }

  function makeSide(letter, index) {
    const canvas = h('canvas', { class: 'cloud' });
    const title = h('strong');
    const trouble = h('span', { class: 'problem' });
    const place = h('span', { class: 'muted', role: 'status' });
    const step = (by, name) =>
      h('button', { class: 'small', 'aria-label': `${name} point of ${letter}`, onclick: () => side.step(by) }, name);
    const caption = h(
      'figcaption',
      null,
      h('span', null, h('span', { class: `cloud-mark cloud-${index}` }, letter), ' ', title),
      trouble,
      h('span', { class: 'row steps' }, step(-1, 'Previous'), step(1, 'Next'), place),
    );
    const viewer = createRegionViewer(canvas, { label: letter, onPick: (point) => side.pick(point.index) });
    let cloud = null;
    let path = null;
    let point = 0;

    const at = () => [0, 1, 2].map((k) => cloud.positions[3 * point + k]);
    const distance = (i, from) => Math.hypot(...from.map((value, k) => cloud.positions[3 * i + k] - value));

    const side = {
      element: h('figure', { class: 'cloud-figure' }, canvas, caption),
      canvas,
      viewer,
      async show(wanted) {
        title.textContent = shortName(wanted);
        title.title = wanted;
        if (path === wanted) return;
        path = wanted;
        cloud = null;
        trouble.textContent = '';
        viewer.setShapes([]);
        viewer.setCloud(null, `${letter}, ${shortName(wanted)}`);
        try {
          const loaded = await load(run(), wanted);
          if (path !== wanted || stop.signal.aborted) return;
          cloud = loaded;
          viewer.setCloud(cloud);
          side.pick(nearestToCentroid(cloud));
        } catch (error) {
          if (path !== wanted) return;
          path = null;
          trouble.textContent = error.message;
        }
      },
      pick(index) {
        point = index;
        side.mark();
        if (told) showLegend();
      },
      step(by) {
        if (!cloud) return;
        const stride = Math.max(1, Math.floor(cloud.count / STEPS));
        side.pick((point + by * stride + cloud.count) % cloud.count);
      },
      /** Points of the cloud in the region around the picked point. */
      within({ inner_cm, outer_cm }) {
        if (!cloud) return '–';
        const from = at();
        let found = 0;
        for (let i = 0; i < cloud.count; i++) {
          const cm = 100 * distance(i, from);
          if (cm >= inner_cm && cm <= outer_cm) found++;
        }
        return found;
      },
      mark() {
        if (!cloud) return;
        place.textContent = `point ${point + 1} of ${cloud.count}`;
        viewer.setShapes(
          regions().map(({ name, outer_cm, colour, dash }) => ({
            kind: 'sphere',
            at_m: at(),
            radius_cm: outer_cm,
            colour,
            dash,
            label: name,
          })),
        );
      },
      dispose: () => viewer.dispose(),
    };
    return side;
  }

  document.addEventListener(
    'keydown',
    (event) => {
      const by = { n: 1, p: -1 }[event.key];
      if (
        !by ||
        event.ctrlKey ||
        event.metaKey ||
        event.altKey ||
        event.target.closest('input, select, textarea, dialog[open]')
      )
        return;
      const focused = sides.filter(({ element }) => element.contains(document.activeElement));
      (focused.length ? focused : sides).forEach((side) => side.step(by));
    },
    { signal: stop.signal },
  );
  // Outlines take their colours from the theme.
  const theme = new MutationObserver(() => sides.forEach(({ viewer }) => viewer.draw()));
  theme.observe(document.documentElement, { attributes: true });
  const scheme = matchMedia('(prefers-color-scheme: dark)');
  scheme.addEventListener('change', () => sides.forEach(({ viewer }) => viewer.draw()), { signal: stop.signal });

  return {
    update(changed) {
      if (['run', 'detail', 'state'].some((name) => changed.has(name))) refresh();
    },
    destroy() {
      stop.abort();
      theme.disconnect();
      sides.forEach((side) => side.dispose());
    },
  };
}

function nearestToCentroid(cloud) {
  const centroid = [0, 1, 2].map((k) => {
    let sum = 0;
    for (let i = k; i < cloud.positions.length; i += 3) sum += cloud.positions[i];
    return sum / cloud.count;
  });
  let [best, least] = [0, Infinity];
  for (let i = 0; i < cloud.count; i++) {
    const off = Math.hypot(...centroid.map((value, k) => cloud.positions[3 * i + k] - value));
    if (off < least) [best, least] = [i, off];
  }
  return best;
}
