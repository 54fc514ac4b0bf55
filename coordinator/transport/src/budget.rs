//! The memory that requests on their way in may take, over all connections.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use proto::Origin;

/// Bytes of requests that have begun and are not whole, by where they come from. What is left when it is full is shared
/// out evenly, so that one origin cannot take the room of others.
#[derive(Debug)]
pub struct RequestBudget {
    most: usize,
    used: Mutex<Used>,
}

#[derive(Debug, Default)]
struct Used {
    total: usize,
    origins: HashMap<Origin, usize>,
}

impl RequestBudget {
    /// So many bytes, of which none are used.
    pub fn new(most: usize) -> Arc<Self> {
        Arc::new(Self { most, used: Mutex::default() })
    }

    /// A share of one request, which has nothing yet.
    pub fn begin(self: &Arc<Self>, origin: Origin) -> RequestShare {
        RequestShare { budget: Arc::clone(self), origin, bytes: 0 }
    }

    fn used(&self) -> MutexGuard<'_, Used> {
        self.used.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What one request takes, until it is dropped.
#[derive(Debug)]
pub struct RequestShare {
    budget: Arc<RequestBudget>,
    origin: Origin,
    bytes: usize,
}

impl RequestShare {
    /// Takes more bytes; `false` if they are too many.
    pub fn grow(&mut self, bytes: usize) -> bool {
        let mut used = self.budget.used();
        self.bytes += bytes;
        used.total += bytes;
        let own = used.origins.entry(self.origin).or_default();
        *own += bytes;
        let own = *own;
        used.total <= self.budget.most || own <= self.budget.most / used.origins.len()
    }
}

impl Drop for RequestShare {
    fn drop(&mut self) {
        let mut used = self.budget.used();
        used.total -= self.bytes;
        if let Some(own) = used.origins.get_mut(&self.origin) {
            *own -= self.bytes;
            if *own == 0 {
                used.origins.remove(&self.origin); // addresses seen once must not fill the memory
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(last: u8) -> Origin {
        Origin::of([192, 0, 2, last].into())
    }

    #[test]
    fn who_fills_the_budget_leaves_the_others_their_share() {
        let budget = RequestBudget::new(1000);
        let mut greedy: Vec<RequestShare> = (0..10).map(|_| budget.begin(origin(1))).collect();
        assert!(greedy.iter_mut().all(|share| share.grow(100)), "as long as nobody else is there");
        assert!(!greedy[0].grow(1));
        let mut honest = budget.begin(origin(2));
        assert!(honest.grow(500), "half of it");
        assert!(!honest.grow(1));
        assert!(!greedy[1].grow(1));
        drop(greedy);
        assert!(honest.grow(400));
        drop(honest);
        assert!(budget.used().origins.is_empty() && budget.used().total == 0);
    }
}
