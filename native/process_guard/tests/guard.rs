//! With real processes: a guarded program ends when it should, and nothing of it is left.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

/// Prints the process ids of its guard, of itself and of a descendant that left group, session
/// and environment.
const DAEMON: &str =
    "echo $PPID; echo $$; (env -i setsid sh -c 'echo $$; exec sleep 600' &); exec sleep 600";

fn guard(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_process_guard"));
    command
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped());
    command
}

/// Starts a shell script under the guard and returns the process ids that it prints first.
fn start(script: &str, lines: usize) -> (Child, Vec<u32>) {
    start_with(&["--grace-ms", "100", "sh", "-c", script], lines)
}

fn start_with(arguments: &[&str], lines: usize) -> (Child, Vec<u32>) {
    let mut child = guard(arguments).spawn().unwrap();
    let output = BufReader::new(child.stdout.take().unwrap());
    let pids = output
        .lines()
        .take(lines)
        .map(|line| line.unwrap().parse().unwrap())
        .collect();
    (child, pids)
}

/// Returns the state letter of a process (R, S, T, Z, …), or `None` when there is no such
/// process.
fn state(pid: u32) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(')')?.1.trim_start().chars().next()
}

fn wait_until(what: &str, condition: impl Fn() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < LIMIT, "{what}: not within {LIMIT:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn wait_until_gone(pid: u32) {
    wait_until("process gone", || matches!(state(pid), None | Some('Z')));
}

fn signal(name: &str, pid: u32) {
    let status = Command::new("kill")
        .args(["-s", name, &pid.to_string()])
        .status();
    assert!(status.unwrap().success());
}

/// Returns what the guard prints until the program ends, and its exit status.
fn output(arguments: &[&str]) -> (Vec<u8>, ExitStatus) {
    let mut child = guard(arguments).spawn().unwrap();
    let mut printed = Vec::new();
    let mut stdout = child.stdout.take().unwrap();
    stdout.read_to_end(&mut printed).unwrap();
    (printed, wait_with_stdin(child))
}

/// Waits with standard input open, which `Child::wait` would close.
fn wait_with_stdin(mut child: Child) -> ExitStatus {
    let _stdin = child.stdin.take();
    child.wait().unwrap()
}

fn close_stdin(child: &mut Child) -> ExitStatus {
    drop(child.stdin.take());
    child.wait().unwrap()
}

#[test]
fn the_programs_exit_status_is_the_guards() {
    let status = wait_with_stdin(guard(&["sh", "-c", "exit 7"]).spawn().unwrap());
    assert_eq!(status.code(), Some(7));
}

#[test]
fn a_signal_that_ends_the_program_gives_the_status_of_a_shell() {
    let status = wait_with_stdin(guard(&["sh", "-c", "kill -9 $$"]).spawn().unwrap());
    assert_eq!(status.code(), Some(137));
}

#[test]
fn a_program_that_does_not_exist_is_named() {
    let output = guard(&["/nonexistent/program"])
        .stderr(Stdio::piped())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(127));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(
        text.contains("cannot run /nonexistent/program: No such file"),
        "{text}"
    );
}

#[test]
fn the_end_of_standard_input_ends_the_program() {
    let (mut child, pids) = start("echo $$; exec sleep 600", 1);
    assert_eq!(close_stdin(&mut child).code(), Some(128 + 15));
    wait_until_gone(pids[0]);
}

#[test]
fn a_program_that_ignores_sigterm_is_killed_after_the_grace() {
    let (mut child, pids) = start("trap '' TERM; echo $$; while :; do sleep 0.05; done", 1);
    assert_eq!(close_stdin(&mut child).code(), Some(128 + 9));
    wait_until_gone(pids[0]);
}

#[test]
fn a_stopped_program_is_killed_after_the_grace() {
    let (mut child, pids) = start("echo $$; kill -STOP $$", 1);
    wait_until("process stopped", || state(pids[0]) == Some('T'));
    assert_eq!(close_stdin(&mut child).code(), Some(128 + 9));
    wait_until_gone(pids[0]);
}

#[test]
fn descendants_that_left_the_group_are_killed_too() {
    let (mut child, pids) = start(
        "setsid sh -c 'echo $$; exec sleep 600' & echo $$; exec sleep 600",
        2,
    );
    close_stdin(&mut child);
    pids.into_iter().for_each(wait_until_gone);
}

#[test]
fn descendants_are_killed_when_the_program_ends_by_itself() {
    let (child, pids) = start(
        "setsid sh -c 'echo $$; exec sleep 600' & sleep 0.2; exit 3",
        1,
    );
    assert_eq!(wait_with_stdin(child).code(), Some(3));
    wait_until_gone(pids[0]);
}

#[test]
fn killing_the_watch_or_the_guard_ends_the_program() {
    let (mut child, pids) = start("echo $$; exec sleep 600", 1);
    child.kill().unwrap();
    child.wait().unwrap();
    wait_until_gone(pids[0]);
}

#[test]
fn the_nice_value_reaches_the_program() {
    let script = ["--nice", "7", "sh", "-c", "nice"];
    let mut child = guard(&script).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    wait_with_stdin(child);
    assert_eq!(line, "7\n");
}

#[test]
fn killing_the_guard_ends_everything_that_it_guards() {
    let (child, pids) = start(DAEMON, 3);
    signal("KILL", pids[0]);
    assert_eq!(wait_with_stdin(child).code(), Some(128 + 9));
    // The watch ends last.
    assert!(
        pids.iter()
            .all(|pid| matches!(state(*pid), None | Some('Z')))
    );
}

#[test]
fn killing_the_watch_ends_everything_that_the_guard_guards() {
    let (mut child, pids) = start(DAEMON, 3);
    child.kill().unwrap();
    child.wait().unwrap();
    pids.into_iter().for_each(wait_until_gone);
}

#[test]
fn a_stopped_guard_is_killed_with_everything_that_it_guards() {
    let (child, pids) = start(DAEMON, 3);
    signal("STOP", pids[0]);
    assert_eq!(wait_with_stdin(child).code(), Some(128 + 9));
    assert!(
        pids.iter()
            .all(|pid| matches!(state(*pid), None | Some('Z')))
    );
}

#[test]
fn a_stopped_watch_ends_nevertheless() {
    let (mut child, pids) = start(DAEMON, 3);
    signal("STOP", child.id());
    assert_eq!(close_stdin(&mut child).code(), Some(128 + 15));
    assert!(
        pids.iter()
            .all(|pid| matches!(state(*pid), None | Some('Z')))
    );
}

#[test]
fn a_program_that_is_stopped_for_too_long_is_killed() {
    let script = "echo $$; kill -STOP $$";
    let mut child = guard(&["--halt-ms", "50", "sh", "-c", script])
        .spawn()
        .unwrap();
    let mut printed = String::new();
    let mut stdout = child.stdout.take().unwrap();
    stdout.read_to_string(&mut printed).unwrap();
    assert_eq!(wait_with_stdin(child).code(), Some(128 + 9));
    let (pid, notice) = printed.split_once('\n').unwrap();
    assert!(
        notice.contains("stopped by a signal for too long"),
        "{notice}"
    );
    wait_until_gone(pid.parse().unwrap());
}

#[test]
fn a_program_that_is_continued_in_time_keeps_running() {
    let script = "echo $$; kill -STOP $$; echo on; exit 4";
    let mut child = guard(&["--halt-ms", "60000", "sh", "-c", script])
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let pid = lines.next().unwrap().unwrap().parse().unwrap();
    wait_until("process stopped", || state(pid) == Some('T'));
    signal("CONT", pid);
    assert_eq!(lines.next().unwrap().unwrap(), "on");
    assert_eq!(wait_with_stdin(child).code(), Some(4));
}

#[test]
fn output_and_errors_arrive_in_order_and_the_last_line_needs_no_end() {
    let script = "echo 1; echo 2 >&2; echo 3; printf 4 >&2; exit 3";
    let (printed, status) = output(&["sh", "-c", script]);
    assert_eq!(String::from_utf8(printed).unwrap(), "1\n2\n3\n4\n");
    assert_eq!(status.code(), Some(3));
}

#[test]
fn output_without_a_line_end_is_split() {
    let script = "head -c 1000000 /dev/zero | tr '\\0' x";
    let (printed, _) = output(&["sh", "-c", script]);
    let lines: Vec<&[u8]> = printed
        .trim_ascii_end()
        .split(|&byte| byte == b'\n')
        .collect();
    assert!(lines.iter().all(|line| line.len() <= 4096));
    assert_eq!(printed.len() - lines.len(), 1_000_000);
}

#[test]
fn a_flood_yields_its_last_lines_and_the_number_of_the_omitted_ones() {
    let script = "seq 300000; echo last words >&2; kill -SEGV $$";
    let (printed, status) = output(&["sh", "-c", script]);
    let printed = String::from_utf8(printed).unwrap();
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(status.code(), Some(128 + 11));
    assert_eq!(lines.first(), Some(&"1"));
    assert_eq!(lines.last(), Some(&"last words"));
    assert!(lines.len() < 30_000, "{} lines", lines.len());
    let accounted = lines.iter().map(|line| {
        let omitted = line
            .strip_prefix("process_guard: ")
            .and_then(|line| line.split_once(' '));
        omitted.map_or(1, |(count, _)| count.parse().unwrap())
    });
    assert_eq!(accounted.sum::<u64>(), 300_001);
}

#[test]
fn a_supervisor_that_reads_nothing_does_not_block_the_program() {
    let script = "echo $$; head -c 10000000 /dev/zero | tr '\\0' '\\n'; exec sleep 600";
    let (mut child, pids) = start(script, 1);
    wait_until("all was printed", || {
        let name = std::fs::read_to_string(format!("/proc/{}/comm", pids[0]));
        name.is_ok_and(|name| name == "sleep\n")
    });
    close_stdin(&mut child);
    wait_until_gone(pids[0]);
}

#[test]
fn no_more_frames_arrive_than_the_supervisor_requested() {
    let mut child = guard(&["--frames", "3", "sh", "-c", "seq 10; exec sleep 600"])
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = child.stdout.take().unwrap();
    let mut frames = |count: usize| -> Vec<String> {
        (0..count)
            .map(|_| {
                let mut length = [0; 2];
                stdout.read_exact(&mut length).unwrap();
                let mut frame = vec![0; u16::from_be_bytes(length).into()];
                stdout.read_exact(&mut frame).unwrap();
                String::from_utf8(frame).unwrap()
            })
            .collect()
    };
    assert_eq!(frames(3), ["l1", "l2", "l3"]);
    stdin.write_all(b"\0\x03c\0\x02").unwrap();
    assert_eq!(frames(2), ["l4", "l5"]);
    // At the end, the rest arrives without a request.
    stdin.write_all(b"\0\x01s").unwrap();
    assert_eq!(frames(6), ["l6", "l7", "l8", "l9", "l10", "e"]);
    // A guard that exits before the acknowledgement would break the pipe under the supervisor's
    // writes.
    assert!(child.try_wait().unwrap().is_none());
    stdin.write_all(b"\0\x01e").unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(128 + 15));
}

#[test]
fn a_program_that_does_not_exist_is_named_in_a_frame_too() {
    let (printed, status) = output(&["--frames", "3", "/nonexistent/program"]);
    assert_eq!(status.code(), Some(127));
    let text = String::from_utf8(printed[2..].to_vec()).unwrap();
    assert!(text.starts_with("lprocess_guard: cannot run /nonexistent/program"));
}
