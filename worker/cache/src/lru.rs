//! A map that forgets what was used least recently once its values take more than a number of bytes.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

/// Values with their sizes. What it holds rests on the order of calls only, not on time or on hashing.
#[derive(Debug)]
pub struct Lru<K, V> {
    capacity: usize,
    bytes: usize,
    /// Counts uses: the larger, the more recent.
    clock: u64,
    values: HashMap<K, Held<V>>,
    /// Keys by last use.
    uses: BTreeMap<u64, K>,
}

#[derive(Debug)]
struct Held<V> {
    value: V,
    bytes: usize,
    used: u64,
}

impl<K: Clone + Eq + Hash, V: Clone> Lru<K, V> {
    /// Holds values of up to `capacity` bytes in all.
    pub fn new(capacity: usize) -> Self {
        Self { capacity, bytes: 0, clock: 0, values: HashMap::new(), uses: BTreeMap::new() }
    }

    /// A value, which is then the most recently used one.
    pub fn get(&mut self, key: &K) -> Option<V> {
        let held = self.values.get_mut(key)?;
        self.clock += 1;
        self.uses.remove(&held.used);
        held.used = self.clock;
        self.uses.insert(self.clock, key.clone());
        Some(held.value.clone())
    }

    /// Holds a value of `bytes` bytes in place of an equal key's, at the expense of others. One that is larger than
    /// the capacity is not held.
    pub fn insert(&mut self, key: K, value: V, bytes: usize) {
        self.remove(&key);
        if bytes > self.capacity {
            return;
        }
        while self.bytes + bytes > self.capacity {
            let Some((_, oldest)) = self.uses.pop_first() else { break };
            self.remove(&oldest);
        }
        self.clock += 1;
        self.bytes += bytes;
        self.uses.insert(self.clock, key.clone());
        self.values.insert(key, Held { value, bytes, used: self.clock });
    }

    fn remove(&mut self, key: &K) {
        if let Some(held) = self.values.remove(key) {
            self.uses.remove(&held.used);
            self.bytes -= held.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_value_goes_first() {
        let mut lru = Lru::new(10);
        lru.insert("a", 1, 4);
        lru.insert("b", 2, 4);
        assert_eq!(lru.get(&"a"), Some(1));
        lru.insert("c", 3, 4);
        assert_eq!([lru.get(&"a"), lru.get(&"b"), lru.get(&"c")], [Some(1), None, Some(3)]);
        lru.insert("d", 4, 10);
        assert_eq!([lru.get(&"a"), lru.get(&"c"), lru.get(&"d")], [None, None, Some(4)]);
    }

    #[test]
    fn what_is_too_large_is_not_held_and_evicts_nothing_else() {
        let mut lru = Lru::new(10);
        lru.insert("a", 1, 10);
        lru.insert("b", 2, 11);
        assert_eq!([lru.get(&"a"), lru.get(&"b")], [Some(1), None]);
        lru.insert("a", 3, 11);
        assert_eq!(lru.get(&"a"), None, "an outdated value stayed");
    }

    #[test]
    fn a_replaced_value_gives_its_room_back() {
        let mut lru = Lru::new(10);
        for value in 0..100 {
            lru.insert("a", value, 6);
            lru.insert("b", value, 4);
            assert_eq!([lru.get(&"a"), lru.get(&"b")], [Some(value), Some(value)]);
        }
        assert_eq!((lru.bytes, lru.values.len(), lru.uses.len()), (10, 2, 2));
    }
}
