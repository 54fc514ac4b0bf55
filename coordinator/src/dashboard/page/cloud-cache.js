// Fetches clouds and keeps the latest, so that going back and forth between wrong answers asks for nothing twice.
import { decodeCloud } from './viewer.js';

const KEPT = 60;
const POINTS = 20000;

/** Returns `load(run, path)` → promise of `{positions, colours, count, total}`. */
export function createCloudCache(api) {
  const clouds = new Map();
  return function load(run, path) {
    const key = `${run}\n${path}`;
    const known = clouds.get(key);
    const cloud = known ?? api.bytes('/api/cloud', { id: run, path, points: POINTS }).then(decodeCloud);
    clouds.delete(key);
    clouds.set(key, cloud);
    cloud.catch(() => clouds.delete(key));
    if (clouds.size > KEPT) clouds.delete(clouds.keys().next().value);
    return cloud;
  };
}

/** The name of a cloud without its folders and `.pcd`. */
export function shortName(path) {
  return path.slice(path.lastIndexOf('/') + 1).replace(/\.pcd$/i, '');
}
