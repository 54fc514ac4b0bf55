// Light or dark: as the system has it, or as the reader chose.

const KEY = 'descry-colours';

function stored() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // A browser may refuse storage; then the system decides.
  }
}

/**
 * @param {HTMLSelectElement} select system, light or dark
 * @param {function(): void} onchange called when colours have changed: canvases must be drawn again
 */
export function createTheme(select, onchange) {
  const apply = (theme) => {
    if (theme === 'light' || theme === 'dark') document.documentElement.dataset.theme = theme;
    else delete document.documentElement.dataset.theme;
  };
  select.value = stored() ?? 'system';
  apply(select.value);
  select.addEventListener('change', () => {
    try {
      localStorage.setItem(KEY, select.value);
    } catch {
      // As above: the choice lasts as long as the page.
    }
    apply(select.value);
    onchange();
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', onchange);
}
