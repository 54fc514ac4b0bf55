// An input for the path of a cloud, which offers those that have the words typed so far.
import { h } from './dom.js';

// Browsers grow slow with longer lists.
const OFFERED = 200;

/** Makes the input of cloud `letter`; `onPick(path or null)` is told what was entered. */
export function cloudInput(letter, onPick) {
  const id = `clouds-${letter}`;
  const options = h('datalist', { id });
  const input = h('input', {
    type: 'text',
    list: id,
    autocomplete: 'off',
    spellcheck: 'false',
    oninput: typed,
    onchange: () => onPick(input.value.trim() || null),
  });
  let all = [];

  function suggest() {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const known = all.some(({ path }) => path === input.value);
    const fitting = known ? all : all.filter(({ path }) => words.every((word) => path.toLowerCase().includes(word)));
    options.replaceChildren(
      ...fitting
        .slice(0, OFFERED)
        .map((cloud) => h('option', { value: cloud.path }, `${cloud.instance}, ${cloud.split}`)),
    );
  }

  function typed() {
    suggest();
    if (all.some(({ path }) => path === input.value)) onPick(input.value);
  }

  return {
    element: h('label', { class: 'field cloud-input' }, `Cloud ${letter}`, input, options),
    offer(list) {
      all = list;
      suggest();
    },
    show(path) {
      if (document.activeElement !== input || all.some((cloud) => cloud.path === input.value)) input.value = path ?? '';
    },
  };
}
