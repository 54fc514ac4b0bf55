// Writes numbers, times and durations for people.

const NONE = '–';
const THIN = '\u202f';

const missing = (value) => value === null || value === undefined || Number.isNaN(value);

/** A share as percent: 0.1204 is `12.04 %`. */
export function percent(share, digits = 2) {
  return missing(share) ? NONE : `${(100 * share).toFixed(digits)}${THIN}%`;
}

/** A difference of two shares in percentage points, with its sign. */
export function points(difference) {
  if (missing(difference)) return NONE;
  const text = (100 * Math.abs(difference)).toFixed(2);
  return text === '0.00' ? '0.00' : `${difference < 0 ? '−' : '+'}${text}`;
}

/** A whole number, in groups of three digits. */
export function count(number) {
  if (missing(number)) return NONE;
  return String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, THIN);
}

/** Any number with about four digits that count. */
export function number(value) {
  if (missing(value)) return NONE;
  if (Number.isInteger(value)) return Math.abs(value) < 10000 ? String(value) : count(value);
  const size = Math.abs(value);
  if (size >= 1e7 || size < 1e-4) return value.toExponential(2);
  return String(Number(value.toPrecision(4)));
}

/** A length of time. */
export function duration(seconds) {
  if (missing(seconds)) return NONE;
  if (seconds === 0) return `0${THIN}s`;
  if (seconds < 0.001) return `${Math.round(seconds * 1e6)}${THIN}µs`;
  if (seconds < 1) return `${Math.round(seconds * 1000)}${THIN}ms`;
  if (seconds < 10) return `${seconds.toFixed(1)}${THIN}s`;
  if (seconds < 60) return `${Math.round(seconds)}${THIN}s`;
  const all = Math.round(seconds);
  const [days, hours] = [Math.floor(all / 86400), Math.floor(all / 3600) % 24];
  const [minutes, rest] = [Math.floor(all / 60) % 60, all % 60];
  if (days > 0) return `${days}${THIN}d ${hours}${THIN}h`;
  if (hours > 0) return `${hours}${THIN}h ${minutes}${THIN}min`;
  return rest > 0 && minutes < 10 ? `${minutes}${THIN}min ${rest}${THIN}s` : `${minutes}${THIN}min`;
}

const two = (part) => String(part).padStart(2, '0');

/** The time of day of milliseconds since 1970, where the reader is. */
export function clock(ms) {
  if (missing(ms)) return NONE;
  const at = new Date(ms);
  return `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
}

/** Day and time of milliseconds since 1970, where the reader is. */
export function moment(ms) {
  if (missing(ms)) return NONE;
  const at = new Date(ms);
  return `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${clock(ms)}`;
}

/** `1 worker`, `2 workers`. */
export function plural(amount, one, many = `${one}s`) {
  return `${count(amount)} ${amount === 1 ? one : many}`;
}

/** What a cell of a table column is to people, by the column's name. */
export function cell(name, value) {
  if (missing(value)) return NONE;
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  if (typeof value !== 'number') return String(value);
  if (/(error|fitness|diversity|hypervolume|difference|regret)(_low|_high)?$|^difference_/.test(name)) {
    return percent(value);
  }
  if (name.endsWith('_ms') || name.endsWith('_at')) return moment(value);
  if (/^seconds|seconds$/.test(name)) return duration(value);
  return number(value);
}
