// The colours of a quantity, from low to high, and their legend. They differ in lightness, so that hue is not needed.

import { colour, h } from './dom.js';
import { linear } from './axes.js';

const STEPS = 16;

function channels(text) {
  const digits = text.replace('#', '');
  return [0, 2, 4].map((at) => parseInt(digits.slice(at, at + 2), 16));
}

const mix = (a, b, share) => a.map((value, index) => Math.round(value + (b[index] - value) * share));

/** Sixteen colours of the theme of now, from low to high, as `rgb(…)`. */
export function rampColours() {
  const [low, middle, high] = ['--ramp-low', '--ramp-middle', '--ramp-high'].map((name) => channels(colour(name)));
  return Array.from({ length: STEPS }, (_, index) => {
    const share = index / (STEPS - 1);
    const rgb = share < 0.5 ? mix(low, middle, share * 2) : mix(middle, high, share * 2 - 1);
    return `rgb(${rgb.join(' ')})`;
  });
}

/** The place of a value in the ramp: 0 to 15. */
export function rampIndex(value, [low, high]) {
  if (!(high > low)) return 0;
  return Math.max(0, Math.min(STEPS - 1, Math.floor(((value - low) / (high - low)) * STEPS)));
}

/** A strip of the ramp's colours between its ends in words. */
export function rampLegend(title, domain, format) {
  const canvas = h('canvas', { width: 160, height: 10, 'aria-hidden': 'true' });
  const context = canvas.getContext('2d');
  const x = linear([0, STEPS], [0, 160]);
  rampColours().forEach((text, index) => {
    context.fillStyle = text;
    context.fillRect(x(index), 0, 160 / STEPS + 1, 10);
  });
  return h('p', { class: 'ramp' }, `${title}: ${format(domain[0])} `, canvas, ` ${format(domain[1])}`);
}
