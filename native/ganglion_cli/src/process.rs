//! Processes as /proc shows them. The results are for people to read and never decide anything:
//! another process may have the id by now, and processes of other users or containers may be
//! invisible.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Returns the name of a process.
pub fn name(pid: u32) -> Option<String> {
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
    Some(name.trim_end().to_owned())
}

/// Returns a process as text: its id, and its name if it has one.
pub fn label(pid: u32) -> String {
    match name(pid) {
        Some(name) => format!("pid {pid} ({name})"),
        None => format!("pid {pid}"),
    }
}

/// Returns the other processes that visibly have a file mapped or open.
pub fn users_of(path: &Path) -> Vec<u32> {
    let Ok(file) = fs::symlink_metadata(path) else {
        return Vec::new();
    };
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut pids: Vec<u32> = entries
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(|&pid| pid != std::process::id())
        .filter(|&pid| has_mapped(pid, file.ino(), file.dev()) || has_open(pid, path))
        .collect();
    pids.sort_unstable();
    pids
}

fn has_mapped(pid: u32, inode: u64, device: u64) -> bool {
    let maps = fs::read_to_string(format!("/proc/{pid}/maps")).unwrap_or_default();
    maps.lines().any(|line| maps_file(line, inode, device))
}

/// Returns whether a line of /proc/PID/maps is a mapping of that file.
fn maps_file(line: &str, inode: u64, device: u64) -> bool {
    let mut fields = line.split_whitespace().skip(3);
    fields.next() == Some(&device_number(device)) && fields.next() == Some(&inode.to_string())
}

/// Formats a device number as /proc/PID/maps does.
fn device_number(device: u64) -> String {
    let major = (device >> 8) & 0xfff | (device >> 32) & !0xfff;
    let minor = device & 0xff | (device >> 12) & !0xff;
    format!("{major:02x}:{minor:02x}")
}

fn has_open(pid: u32, path: &Path) -> bool {
    let descriptors = fs::read_dir(format!("/proc/{pid}/fd"))
        .into_iter()
        .flatten()
        .flatten();
    descriptors
        .into_iter()
        .any(|fd| fs::read_link(fd.path()).is_ok_and(|target| target == path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mapping_is_recognised_by_device_and_inode() {
        let line = "7f64a1c00000-7f64a1c11000 rw-s 00000000 00:1b 4711     /dev/shm/conduit_imu";
        assert!(maps_file(line, 4711, 0x1b));
        assert!(!maps_file(line, 4712, 0x1b));
        assert!(!maps_file(line, 4711, 0x1c));
        assert!(!maps_file("", 0, 0));
        assert_eq!(device_number(0x0010_0803), "08:103");
    }

    #[test]
    fn this_process_has_a_name() {
        assert!(label(std::process::id()).contains('('));
        assert_eq!(label(u32::MAX), format!("pid {}", u32::MAX));
    }
}
