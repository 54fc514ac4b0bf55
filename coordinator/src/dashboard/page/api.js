// Asks the server, and asks the reader for a token where the server wants one.

import { h, replace } from './dom.js';

function address(path, parameters) {
  const query = new URLSearchParams();
  for (const [key, value] of Object.entries(parameters ?? {})) {
    if (value !== null && value !== undefined) query.set(key, String(value));
  }
  const text = query.toString();
  return text === '' ? path : `${path}?${text}`;
}

/** What the server said instead of an answer; `status` is 0 if nothing answered at all. */
class ApiError extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

async function failure(response) {
  try {
    const body = await response.json();
    return new ApiError(response.status, String(body.error));
  } catch {
    return new ApiError(response.status, `the server answered with status ${response.status}`);
  }
}

/**
 * @param {HTMLElement} box where the token is asked for
 */
export function createApi(box) {
  let asking = null;

  function login() {
    asking ??= new Promise((resolve) => {
      const input = h('input', { type: 'password', name: 'token', autocomplete: 'current-password', required: true });
      const problem = h('p', { class: 'problem', role: 'alert' });
      const send = async (event) => {
        event.preventDefault();
        try {
          const body = JSON.stringify({ token: input.value });
          const headers = { 'Content-Type': 'application/json' };
          const response = await fetch('/api/login', { method: 'POST', body, headers });
          if (!response.ok) {
            problem.textContent =
              response.status === 401 ? 'This token is not known.' : (await failure(response)).message;
            input.select();
            return;
          }
        } catch {
          problem.textContent = 'The coordinator does not answer. Try again when it is back.';
          return;
        }
        replace(box);
        asking = null;
        resolve();
      };
      const form = h(
        'form',
        { class: 'panel login', 'aria-label': 'Token', onsubmit: send },
        h('h2', null, 'Token'),
        h('p', null, 'This dashboard asks for a token. Whoever started the coordinator has it.'),
        h('label', { class: 'field' }, 'Token', input),
        h('button', { class: 'primary' }, 'Log in'),
        problem,
      );
      replace(box, form);
      input.focus();
    });
    return asking;
  }

  async function ask(path, options) {
    for (;;) {
      let response;
      try {
        response = await fetch(path, options);
      } catch (error) {
        throw new ApiError(0, `the coordinator does not answer: ${error.message}`);
      }
      if (response.status === 401) {
        await login();
        continue;
      }
      if (!response.ok) throw await failure(response);
      return response;
    }
  }

  return {
    /** The JSON at a path. */
    get: async (path, parameters, signal) => (await ask(address(path, parameters), { signal })).json(),
    /** The bytes at a path. */
    bytes: async (path, parameters) => (await ask(address(path, parameters), {})).arrayBuffer(),
    /** Sends JSON and returns the answer's, or null if it has none. */
    async post(path, body) {
      const headers = { 'Content-Type': 'application/json' };
      const response = await ask(path, { method: 'POST', body: JSON.stringify(body), headers });
      return response.status === 204 ? null : response.json();
    },
    address,
  };
}
