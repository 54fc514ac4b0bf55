//! What a worker says of itself.

/// Which build this is, for the record.
pub const BUILD: &str = concat!("descry ", env!("CARGO_PKG_VERSION"));

/// How a worker presents itself.
#[derive(Clone, Debug)]
pub struct Identity {
    /// Label for people; made unique by the coordinator.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
}
