// What the page shows, kept in the fragment of its address, so that a copied address shows the same.

function parse(fragment) {
  const values = new Map();
  for (const part of fragment.replace(/^#/, '').split('&')) {
    const at = part.indexOf('=');
    if (at < 1) continue;
    try {
      values.set(decodeURIComponent(part.slice(0, at)), decodeURIComponent(part.slice(at + 1)));
    } catch {
      // A damaged escape says nothing: the rest of the address still counts.
    }
  }
  return values;
}

const readable = (text) => encodeURIComponent(text).replace(/%(2F|3A|2C|3B)/g, (all) => decodeURIComponent(all));

function print(values) {
  return [...values].map(([key, value]) => `${readable(key)}=${readable(value)}`).join('&');
}

/**
 * @param {function(): void} onchange called after every change, by the page or by the reader's browser
 */
export function createState(onchange) {
  let values = parse(location.hash);

  function write(next, push) {
    const text = print(next);
    if (text === print(values)) return;
    values = next;
    const address = text === '' ? location.pathname + location.search : `#${text}`;
    if (push) history.pushState(null, '', address);
    else history.replaceState(null, '', address);
    onchange();
  }

  function reread() {
    const next = parse(location.hash);
    if (print(next) === print(values)) return;
    values = next;
    onchange();
  }
  addEventListener('popstate', reread);
  addEventListener('hashchange', reread);

  return {
    /** The value of a key, or null. */
    get: (key) => values.get(key) ?? null,
    /** Sets some keys; null removes one. `push` makes a step to which the reader's Back returns. */
    set(changes, push = false) {
      const next = new Map(values);
      for (const [key, value] of Object.entries(changes)) {
        if (value === null || value === undefined || value === '') next.delete(key);
        else next.set(key, String(value));
      }
      write(next, push);
    },
    /** Replaces all keys. */
    replace(all) {
      write(new Map(Object.entries(all).filter(([, value]) => value !== null)), true);
    },
    /** The fragment for other values of some keys, as links need it. */
    link(changes, keep = true) {
      const next = keep ? new Map(values) : new Map();
      for (const [key, value] of Object.entries(changes)) {
        if (value === null) next.delete(key);
        else next.set(key, String(value));
      }
      return `#${print(next)}`;
    },
  };
}
