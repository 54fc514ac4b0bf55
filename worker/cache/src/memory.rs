//! How much memory this process holds.

use bytesize::ByteSize;
use sysinfo::{ProcessRefreshKind, ProcessesToUpdate, System};

/// Memory that this process holds at the moment (its resident set), if the system tells.
pub fn held_memory() -> Option<ByteSize> {
    let own = sysinfo::get_current_pid().ok()?;
    let mut system = System::new();
    let memory = ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[own]), false, memory);
    system.process(own).map(|process| ByteSize(process.memory()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_written_to_is_held() {
        const MORE: usize = 64 << 20;
        let before = held_memory().unwrap().as_u64();
        let used = vec![1_u8; MORE];
        let after = held_memory().unwrap().as_u64();
        assert!(before > 0 && after >= MORE as u64, "{before} {after}");
        assert_eq!(used.iter().map(|&byte| usize::from(byte)).sum::<usize>(), MORE);
    }
}
