//! How a worker introduces itself when it registers.

use crate::principal::{Origin, Principal};

/// What a worker says of itself, and who answers for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Introduction {
    /// The name its operator gave it.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Its build string.
    pub build: String,
    /// By what it has shown, not by what it says.
    pub principal: Principal,
}

impl Introduction {
    /// For tests: a worker of this name, at an address that has this last byte.
    #[doc(hidden)]
    pub fn sample(name: &str, address: u8) -> Self {
        let principal = Principal::Anonymous(Origin::of([192, 0, 2, address].into()));
        Self { name: name.to_owned(), threads: 1, build: "test".to_owned(), principal }
    }
}
