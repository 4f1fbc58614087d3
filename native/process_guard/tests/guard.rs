//! Real processes: what is guarded ends when it should, and nothing of it is left.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

fn guard(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_process_guard"));
    command
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped());
    command
}

/// Starts a shell script under the guard and gives the lines that it prints first: process numbers.
fn start(script: &str, lines: usize) -> (Child, Vec<u32>) {
    let mut child = guard(&["--grace-ms", "100", "sh", "-c", script])
        .spawn()
        .unwrap();
    let output = BufReader::new(child.stdout.take().unwrap());
    let pids = output
        .lines()
        .take(lines)
        .map(|line| line.unwrap().parse().unwrap())
        .collect();
    (child, pids)
}

/// The state letter of a process as the kernel gives it: R, S, T, Z, …; none when there is no such process.
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

/// Keeps standard input open meanwhile, which `Child::wait` would close.
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
fn a_signal_that_ends_the_program_is_told_as_a_shell_tells_it() {
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
fn the_death_of_the_guard_is_the_death_of_the_program() {
    let (mut child, pids) = start("echo $$; exec sleep 600", 1);
    child.kill().unwrap();
    child.wait().unwrap();
    wait_until_gone(pids[0]);
}

#[test]
fn a_nice_program_gives_way_to_others() {
    let script = ["--nice", "7", "sh", "-c", "nice"];
    let mut child = guard(&script).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    wait_with_stdin(child);
    assert_eq!(line, "7\n");
}
