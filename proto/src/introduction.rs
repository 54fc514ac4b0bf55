//! How a worker introduces itself when it registers.

/// What a worker says of itself, and how it was authenticated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Introduction {
    /// The name its operator gave it.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Its build string.
    pub build: String,
    /// `token`, or `certificate` and its fingerprint; `None` where no authentication is required.
    pub credential: Option<String>,
}

impl Introduction {
    /// For tests: an unauthenticated worker of this name.
    #[doc(hidden)]
    pub fn sample(name: &str) -> Self {
        Self { name: name.to_owned(), threads: 1, build: "test".to_owned(), credential: None }
    }
}
