// A stream of server-sent events that comes back by itself, from where it broke off. It rests while nobody sees the
// page: a browser holds six connections to a host, and the stream of each tab would keep one of them from the others.

const FIRST_DELAY = 500;
const LONGEST_DELAY = 5000;
const SILENCE = 20_000;

/**
 * @param {object} options
 * @param {function(): string} options.address the address to (re)connect to, with what has been seen
 * @param {Object<string, function(any): void>} options.handlers by name of event
 * @param {function(): Promise<void>} options.probe asks the server for something small: logs in where that is needed
 * @param {function('connecting'|'open'|'lost'): void} options.onconnection the state
 * @param {function(): void} options.onrefused called when the server answers, but not with this stream
 */
export function openStream({ address, handlers, probe, onconnection, onrefused }) {
  let source = null;
  let timer = 0;
  let delay = FIRST_DELAY;
  let heard = Date.now();
  let closed = false;
  let rests = false;

  function later() {
    if (closed || rests) return;
    clearTimeout(timer);
    timer = setTimeout(retry, delay);
    delay = Math.min(delay * 1.6, LONGEST_DELAY);
  }

  function lose() {
    source?.close();
    source = null;
    if (closed) return;
    onconnection('lost');
    later();
  }

  async function retry() {
    try {
      await probe();
    } catch {
      lose();
      return;
    }
    if (!closed && !rests) connect();
  }

  /** The stream did not even begin: either nobody answers, or the server does not have it. */
  async function refuse() {
    source?.close();
    source = null;
    try {
      await probe();
    } catch {
      lose();
      return;
    }
    if (closed) return;
    onrefused();
    later();
  }

  function connect() {
    if (document.hidden) {
      rests = true;
      return;
    }
    source?.close();
    let opened = false;
    source = new EventSource(address());
    heard = Date.now();
    source.onopen = () => {
      opened = true;
      heard = Date.now();
      delay = FIRST_DELAY;
      onconnection('open');
    };
    source.onerror = () => (opened ? lose() : refuse());
    for (const [name, handle] of Object.entries(handlers)) {
      source.addEventListener(name, (event) => {
        heard = Date.now();
        handle(JSON.parse(event.data));
      });
    }
  }

  // A machine that is gone closes no connection: after a silence, somebody has to ask.
  const watch = setInterval(async () => {
    if (source === null || Date.now() - heard < SILENCE) return;
    heard = Date.now();
    try {
      await probe();
    } catch {
      lose();
    }
  }, 5000);

  function rest() {
    if (closed) return;
    if (document.hidden) {
      clearTimeout(timer);
      source?.close();
      source = null;
      rests = true;
    } else if (rests) {
      rests = false;
      connect();
    }
  }
  document.addEventListener('visibilitychange', rest);

  onconnection('connecting');
  connect();

  return {
    /** Connects again at once. */
    restart() {
      clearTimeout(timer);
      connect();
    },
    close() {
      closed = true;
      document.removeEventListener('visibilitychange', rest);
      source?.close();
      clearTimeout(timer);
      clearInterval(watch);
    },
  };
}
