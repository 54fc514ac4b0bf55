// The run at a glance: verdict, errors with intervals, what it was compared with, front, channels, looks, experiment.

import { linear, ticks } from './axes.js';
import { h, onWidth, replace, svg } from './dom.js';
import { FRONT_COLUMNS } from './front.js';
import { count, moment, number, percent } from './format.js';
import { plainTable } from './table.js';

const SPLITS = { train: 'training', validation: 'validation', 'train weighed': 'training, weighed', test: 'test' };

function panel(title, ...children) {
  return h('section', { class: 'panel' }, h('h2', null, title), ...children);
}

/** Errors as points with their intervals, the known optimum as a line. */
function intervals(rows, optimum, width) {
  const left = Math.min(190, width * 0.34);
  const most = Math.max(...rows.map(({ high, error }) => high ?? error), optimum ?? 0);
  const x = linear([0, most * 1.05 || 1], [left, width - 16]);
  const height = rows.length * 26 + 34;
  const picture = svg('svg', { width, height, viewBox: `0 0 ${width} ${height}`, 'aria-hidden': 'true' });
  for (const value of ticks(0, x.domain[1], Math.max(2, (width - left) / 80))) {
    picture.append(
      svg('line', { class: 'grid', x1: x(value), x2: x(value), y1: 4, y2: height - 26 }),
      svg('text', { class: 'tick', x: x(value), y: height - 10, 'text-anchor': 'middle' }, percent(value, 0)),
    );
  }
  rows.forEach(({ name, error, low, high, strong }, index) => {
    const y = index * 26 + 18;
    const paint = {
      style: { stroke: strong ? 'var(--c1)' : 'var(--muted)', fill: strong ? 'var(--c1)' : 'var(--muted)' },
    };
    picture.append(
      svg('text', { class: strong ? 'label strong' : 'label', x: left - 10, y: y + 4, 'text-anchor': 'end' }, name),
    );
    if (low !== null && low !== undefined) {
      picture.append(svg('line', { ...paint, 'stroke-width': 2, x1: x(low), x2: x(high), y1: y, y2: y }));
    }
    picture.append(svg('circle', { ...paint, cx: x(error), cy: y, r: 4.5 }));
  });
  if (optimum !== null && optimum !== undefined) {
    picture.append(
      svg('line', {
        class: 'level',
        x1: x(optimum),
        x2: x(optimum),
        y1: 2,
        y2: height - 26,
        'stroke-dasharray': '2 3',
        style: { stroke: 'var(--good)' },
      }),
    );
  }
  return picture;
}

function errorRows(detail) {
  return detail.errors.map((row) => ({
    name: (SPLITS[row.split] ?? row.split).replace(/^\w+/, '$& clouds'),
    error: row.object_error,
    low: row.low,
    high: row.high,
    strong: true,
  }));
}

function comparedRows({ rows, columns }) {
  return Array.from({ length: rows }, (_, row) => ({
    name: columns.descriptor[row],
    error: columns.object_error[row],
    low: columns.object_error_low?.[row] ?? null,
    high: columns.object_error_high?.[row] ?? null,
    strong: columns.descriptor[row] === 'evolved',
  }));
}

function errorsTable(detail) {
  const head = ['Clouds', 'Object error', '95 % interval', 'Category error', 'Queries'];
  const rows = detail.errors.map((row) =>
    h(
      'tr',
      null,
      h('th', { scope: 'row' }, SPLITS[row.split] ?? row.split),
      h('td', { class: 'number' }, `${percent(row.object_error)} (${count(row.object_wrong)})`),
      h('td', { class: 'number' }, row.low === null ? '–' : `${percent(row.low, 1)} – ${percent(row.high, 1)}`),
      h('td', { class: 'number' }, `${percent(row.category_error)} (${count(row.category_wrong)})`),
      h('td', { class: 'number' }, count(row.queries)),
    ),
  );
  const th = (text, index) => h('th', { scope: 'col', class: index > 0 ? 'number' : null }, text);
  return h(
    'div',
    { class: 'scroll' },
    h('table', null, h('thead', null, h('tr', null, head.map(th))), h('tbody', null, rows)),
  );
}

function figureOf(rows, optimum, text) {
  const figure = h('figure', { class: 'intervals', role: 'img', 'aria-label': text });
  const stop = onWidth(figure, (width) => replace(figure, intervals(rows, optimum, width)));
  return { figure, stop };
}

const COMPARED = [
  ['descriptor', 'Descriptor'],
  ['object_error', 'Object error'],
  ['object_error_low', 'low'],
  ['object_error_high', 'high'],
  ['category_error', 'Category error'],
  ['queries', 'Clouds'],
  ['cloud_size', 'Values a cloud'],
  ['seconds_cloud', 'Time a cloud'],
  ['note', 'Note'],
];
const PAIRS = [
  ['descriptor_a', 'First'],
  ['descriptor_b', 'Second'],
  ['level', 'Level'],
  ['error_difference', 'Difference'],
  ['difference_low', 'low'],
  ['difference_high', 'high'],
  ['p_value', 'p'],
  ['p_adjusted', 'p after Holm'],
];

function verdictPanel(detail) {
  const { run } = detail;
  const sentences = run.verdict?.length
    ? run.verdict.map((sentence) => h('p', { class: 'verdict' }, sentence))
    : h(
        'p',
        { class: 'muted' },
        run.state === 'finished'
          ? 'This run has no verdict.'
          : 'The verdict comes when the run has ended: the winner is then measured on test clouds.',
      );
  const made = panel('Verdict', sentences);
  made.classList.add('wide');
  return made;
}

/** How far a channel looks: the outermost of its regions. */
function radiusText({ regions }) {
  if (regions.length === 0) return 'whole cloud';
  return `${number(Math.max(...regions.map(({ outer_cm }) => outer_cm)))} cm`;
}

function winnerPanel(detail, context) {
  if (detail.winner === null) return null;
  const { generation, individual, text } = detail.winner;
  const open = () => context.navigate('population', { selected: `${generation}.${individual}` });
  const channels = detail.channels?.length
    ? h(
        'div',
        { class: 'scroll' },
        h(
          'table',
          null,
          h(
            'thead',
            null,
            h(
              'tr',
              null,
              ['Channel', 'Weight', 'Values', 'Radius'].map((name, at) =>
                h('th', { scope: 'col', class: at > 0 ? 'number' : null }, name),
              ),
            ),
          ),
          h(
            'tbody',
            null,
            detail.channels.map((channel) =>
              h(
                'tr',
                null,
                h('th', { scope: 'row' }, channel.text),
                h('td', { class: 'number' }, number(channel.weight)),
                h('td', { class: 'number' }, number(channel.values)),
                h('td', { class: 'number' }, radiusText(channel)),
              ),
            ),
          ),
        ),
      )
    : null;
  return panel(
    `Winner: generation ${generation}, individual ${individual}`,
    h('pre', { class: 'descriptor' }, text),
    channels,
    h(
      'p',
      { class: 'row' },
      h('button', { onclick: open }, 'Its lineage'),
      h('button', { onclick: () => context.navigate('descriptor') }, 'What it looks at'),
    ),
  );
}

function looksPanel(detail) {
  const shown = {
    none: 'This experiment has no test clouds.',
    'hidden until the search ends': 'Test clouds are hidden until the search ends.',
    shown: 'Test clouds may be shown.',
  };
  const looks = detail.looks ?? [];
  const rows = looks.map((look) =>
    h(
      'tr',
      null,
      h('th', { scope: 'row' }, moment(look.at_ms)),
      h('td', null, look.command),
      h('td', null, look.reason),
      h('td', null, look.descriptors),
    ),
  );
  const head = ['When', 'Command', 'Reason', 'Descriptors'].map((name) => h('th', { scope: 'col' }, name));
  return panel(
    `Looks at test clouds: ${count(looks.length)}`,
    h('p', { class: 'muted' }, shown[detail.test_clouds] ?? detail.test_clouds),
    rows.length > 0 &&
      h('div', { class: 'scroll' }, h('table', null, h('thead', null, h('tr', null, head)), h('tbody', null, rows))),
  );
}

function optimumText(run) {
  if (run.optimum_error === null) return null;
  const regret = run.regret === null ? '' : ` This run ended ${percent(run.regret)} above it (regret).`;
  return h(
    'p',
    null,
    `Known optimum of the whole search space: ${percent(run.optimum_error)} training error.${regret}`,
  );
}

function experimentPanel(detail) {
  const digests = Object.entries(detail.digests ?? {}).filter(([, value]) => value);
  return panel(
    'Experiment',
    h('p', null, `Method ${detail.method}, family ${detail.family}, objectives ${detail.objectives.join(', ')}.`),
    digests.length > 0 &&
      h(
        'dl',
        { class: 'digests' },
        digests.map(([name, value]) => [h('dt', null, name.replace(/_/g, ' ')), h('dd', null, h('code', null, value))]),
      ),
    h('details', null, h('summary', null, 'The experiment file'), h('pre', null, detail.toml)),
  );
}

export const view = {
  id: 'overview',
  title: 'Overview',
  create(root, context) {
    const { store } = context;
    let stops = [];
    let drawn = null;

    const figure = (rows, optimum, text) => {
      const made = figureOf(rows, optimum, text);
      stops.push(made.stop);
      return made.figure;
    };

    function errorsPanel(detail) {
      const { run } = detail;
      if (detail.errors.length === 0) {
        return panel(
          'Errors',
          h('p', { class: 'muted' }, 'Errors with intervals come when the run has ended.'),
          optimumText(run),
        );
      }
      const said = detail.errors
        .map((row) => `${SPLITS[row.split] ?? row.split} ${percent(row.object_error)}`)
        .join(', ');
      return panel(
        'Object errors of the winner',
        figure(errorRows(detail), run.optimum_error, `Object errors with 95 % intervals: ${said}`),
        errorsTable(detail),
        optimumText(run),
      );
    }

    function comparedPanel(detail) {
      if (detail.compared === null) return null;
      const rows = comparedRows(detail.compared);
      const said = rows.map(({ name, error }) => `${name} ${percent(error)}`).join(', ');
      return panel(
        'Compared on the test clouds',
        figure(rows, null, `Object errors on test clouds with 95 % intervals: ${said}`),
        plainTable('Compared descriptors', detail.compared, COMPARED),
        detail.pairs &&
          h(
            'details',
            null,
            h('summary', null, 'Every pair: difference, interval, McNemar’s test'),
            plainTable('Pairs of descriptors', detail.pairs, PAIRS),
          ),
      );
    }

    function draw() {
      const { detail } = store;
      stops.forEach((stop) => stop());
      stops = [];
      if (detail === null) {
        replace(root, h('p', { class: 'muted' }, 'Waiting for the run …'));
        return;
      }
      replace(
        root,
        h(
          'div',
          { class: 'grid' },
          verdictPanel(detail),
          errorsPanel(detail),
          comparedPanel(detail),
          winnerPanel(detail, context),
          detail.front &&
            panel(
              'Front',
              h('p', { class: 'muted' }, 'Descriptors of which none is better than another in all objectives.'),
              plainTable('Front', detail.front, FRONT_COLUMNS),
            ),
          looksPanel(detail),
          experimentPanel(detail),
        ),
      );
    }

    return {
      update(changed) {
        if (!changed.has('detail')) return;
        const { detail } = store;
        const { state, verdict, optimum_error, regret } = detail?.run ?? {};
        const text = JSON.stringify({ ...detail, run: { state, verdict, optimum_error, regret } });
        if (text === drawn) return;
        drawn = text;
        draw();
      },
      destroy() {
        stops.forEach((stop) => stop());
      },
    };
  },
};
