//! Files and folders that are visible only whole: temporary name, sync, rename, sync of the folder; and locks of files.
//!
//! A reader sees the former state or the new one, also after a crash. What a killed process leaves behind has a name
//! that [`is_temporary`] knows.

mod file;
mod folder;
mod lock;
mod temporary;

pub use file::{remove, sync_folder, write, write_secret, write_unsynced, write_with};
pub use folder::{NewFolder, remove_abandoned};
pub use lock::{is_locked, try_lock};
pub use temporary::{Access, is_abandoned, is_temporary};

#[cfg(test)]
mod tests;
