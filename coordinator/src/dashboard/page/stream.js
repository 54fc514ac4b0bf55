// A stream of server-sent events that comes back by itself, from where it broke off.

const FIRST_DELAY = 500;
const LONGEST_DELAY = 5000;
const SILENCE = 20_000;

/**
 * @param {object} options
 * @param {function(): string} options.address the address to (re)connect to, with what has been seen
 * @param {Object<string, function(any): void>} options.handlers by name of event
 * @param {function(): Promise<void>} options.probe asks the server for something small: logs in where that is needed
 * @param {function('connecting'|'open'|'lost', number=): void} options.onconnection the state, and when lost the
 *   time of the next attempt
 */
export function openStream({ address, handlers, probe, onconnection }) {
  let source = null;
  let timer = 0;
  let delay = FIRST_DELAY;
  let heard = Date.now();
  let closed = false;

  function lose() {
    source?.close();
    source = null;
    if (closed) return;
    onconnection('lost', Date.now() + delay);
    clearTimeout(timer);
    timer = setTimeout(retry, delay);
    delay = Math.min(delay * 1.6, LONGEST_DELAY);
  }

  async function retry() {
    try {
      await probe();
    } catch {
      lose();
      return;
    }
    if (!closed) connect();
  }

  function connect() {
    source = new EventSource(address());
    heard = Date.now();
    source.onopen = () => {
      heard = Date.now();
      delay = FIRST_DELAY;
      onconnection('open');
    };
    source.onerror = lose;
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

  onconnection('connecting');
  connect();

  return {
    /** Connects again at once. */
    restart() {
      source?.close();
      clearTimeout(timer);
      connect();
    },
    close() {
      closed = true;
      source?.close();
      clearTimeout(timer);
      clearInterval(watch);
    },
  };
}
