//! Compilers, the programs that they build, and processes of these programs.

#[path = "../../../conduit_ring/tests/support/run.rs"]
mod run;

use std::ffi::OsStr;
use std::fs;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use conduit_ring::Topic;

/// The timeout of every wait.
pub const LIMIT: Duration = Duration::from_secs(60);

const STRICT: [&str; 4] = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"];
const SANITIZED: [&str; 3] = [
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    C,
    Cpp,
}

impl Language {
    fn compiler(self) -> String {
        let (variable, usual) = match self {
            Language::C => ("CC", "cc"),
            Language::Cpp => ("CXX", "c++"),
        };
        std::env::var(variable).unwrap_or_else(|_| usual.to_owned())
    }

    fn standard(self) -> &'static str {
        match self {
            Language::C => "-std=c11",
            Language::Cpp => "-std=c++17",
        }
    }

    /// Returns a command that compiles strictly, or `None` with a line on stderr without a
    /// compiler.
    pub fn compile(self) -> Option<Command> {
        let compiler = self.compiler();
        if !has(&compiler) {
            let package = match self {
                Language::C => "gcc",
                Language::Cpp => "g++",
            };
            skip(&format!(
                "no compiler {compiler} (Debian's package {package})"
            ));
            return None;
        }
        let mut command = Command::new(compiler);
        command
            .arg(self.standard())
            .args(STRICT)
            .args(["-g", "-pthread", "-I"])
            .arg(include_dir());
        Some(command)
    }
}

/// Returns the crate's folder.
pub fn home() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub fn include_dir() -> PathBuf {
    home().join("include")
}

/// Returns the folder of this build's `libconduit_ring_c.so` and `.a`, beside this program.
pub fn built_dir() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().unwrap().to_owned()
}

pub fn has(program: &str) -> bool {
    let version = Command::new(program)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    version.is_ok_and(|status| status.success())
}

/// Returns whether a C++ source of these lines compiles. Prints a line if not.
pub fn compiles(lines: &str, flags: &[&str]) -> bool {
    let Some(mut compile) = Language::Cpp.compile() else {
        return false;
    };
    let mut compiler = compile
        .args(flags)
        .args(["-fsyntax-only", "-x", "c++", "-"])
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut source = compiler.stdin.take().unwrap();
    writeln!(source, "{lines}").unwrap();
    drop(source);
    let compiles = compiler.wait().unwrap().success();
    if !compiles {
        skip(&format!("the compiler refuses {lines:?} with {flags:?}"));
    }
    compiles
}

/// Prints directly to the descriptor, because the test harness hides the output of a passing
/// test.
pub fn skip(reason: &str) {
    let _ = writeln!(io::stderr(), "skipped: {reason}");
}

/// Returns a folder for a test's files, which may contain files of an earlier run.
pub fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("conduit_ring_c")
        .join(name);
    fs::create_dir_all(&path).unwrap();
    path
}

/// Returns an empty folder.
pub fn fresh_folder(name: &str) -> PathBuf {
    fs::remove_dir_all(folder(name)).unwrap();
    folder(name)
}

/// Runs a command and asserts that it succeeds.
pub fn succeed(command: &mut Command) -> Output {
    let output = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// Compiles `programs/<source>` and links it with the static library.
fn build(language: Language, source: &str, flags: &[&str], to: &Path) -> Option<()> {
    let mut compile = language.compile()?;
    let page = home().join("../../docs/wire-format.md");
    compile
        .args(flags)
        .arg(format!("-DWIRE_FORMAT=\"{}\"", page.display()))
        .arg(home().join("tests/c_and_cpp/programs").join(source))
        .arg(built_dir().join("libconduit_ring_c.a"))
        .args(["-ldl", "-lm", "-o"])
        .arg(to);
    succeed(&mut compile);
    Some(())
}

/// A program of `programs/`, compiled once per run.
pub struct Program {
    language: Language,
    source: &'static str,
    pub flags: &'static [&'static str],
    built: OnceLock<Option<PathBuf>>,
}

pub static C_CASES: Program = Program::new(Language::C, "cases.c", &[]);
pub static CPP_CASES: Program = Program::new(Language::Cpp, "cases.cpp", &[]);
pub static CPP_CASES_BY_PLAIN_FORMAT: Program =
    Program::new(Language::Cpp, "cases.cpp", &["-DCONDUIT_LOG_PLAIN_FORMAT"]);
pub static CPP_CASES_BY_FMT: Program = Program::new(
    Language::Cpp,
    "cases.cpp",
    &["-std=c++17", "-DFMT_HEADER_ONLY"],
);
pub static CPP_CASES_BY_STD_FORMAT: Program =
    Program::new(Language::Cpp, "cases.cpp", &["-std=c++20"]);
pub static C_PEER: Program = Program::new(Language::C, "peer.c", &["-O2"]);
pub static CPP_PEER: Program = Program::new(Language::Cpp, "peer.cpp", &["-O2"]);
pub static SANITIZED_C_CASES: Program = Program::new(Language::C, "cases.c", &SANITIZED);
pub static SANITIZED_CPP_CASES: Program = Program::new(Language::Cpp, "cases.cpp", &SANITIZED);

impl Program {
    const fn new(
        language: Language,
        source: &'static str,
        flags: &'static [&'static str],
    ) -> Program {
        Program {
            language,
            source,
            flags,
            built: OnceLock::new(),
        }
    }

    /// Returns a command that runs the program.
    pub fn command(&self) -> Option<Command> {
        self.built
            .get_or_init(|| {
                let to = folder("programs").join(self.name());
                build(self.language, self.source, self.flags, &to).map(|()| to)
            })
            .as_ref()
            .map(Command::new)
    }

    /// Returns a file name that distinguishes the program by its flags.
    fn name(&self) -> String {
        let mut name = self.source.replace('.', "_");
        for flag in self.flags {
            name.push('.');
            name.extend(flag.chars().filter(char::is_ascii_alphanumeric));
        }
        name
    }

    /// Starts the program with pipes.
    pub fn start<A: AsRef<OsStr>>(
        &self,
        arguments: impl IntoIterator<Item = A>,
    ) -> Option<Process> {
        let mut command = self.command()?;
        command.args(arguments);
        Some(Process::start(command))
    }
}

/// Returns whether the compiler can build a program with the sanitizers and this machine run it.
pub fn can_sanitize(language: Language) -> bool {
    let Some(mut compile) = language.compile() else {
        return false;
    };
    let folder = folder(&format!("sanitizer_{language:?}"));
    let source = folder.join(match language {
        Language::C => "empty.c",
        Language::Cpp => "empty.cpp",
    });
    fs::write(&source, "int main(void) { return 0; }\n").unwrap();
    let program = folder.join("empty");
    let compiled = compile
        .args(SANITIZED)
        .arg(&source)
        .arg("-o")
        .arg(&program)
        .output()
        .is_ok_and(|output| output.status.success());
    let works = compiled
        && Command::new(&program)
            .output()
            .is_ok_and(|o| o.status.success());
    if !works {
        skip(&format!(
            "{language:?}: the compiler has no AddressSanitizer here"
        ));
    }
    works
}

/// A running program. Killed on drop.
pub struct Process {
    child: Child,
    lines: io::Lines<BufReader<std::process::ChildStdout>>,
    input: Option<ChildStdin>,
}

impl Process {
    pub fn start(mut command: Command) -> Process {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|e| panic!("{command:?}: {e}"));
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let input = child.stdin.take();
        Process {
            child,
            lines,
            input,
        }
    }

    /// Returns the next line that the program prints.
    pub fn line(&mut self) -> String {
        self.lines
            .next()
            .expect("a line, not the end")
            .expect("a line")
    }

    pub fn expect(&mut self, line: &str) {
        assert_eq!(self.line(), line);
    }

    /// Sends a line, for which the program waits.
    pub fn go(&mut self) {
        self.input.as_mut().unwrap().write_all(b"\n").unwrap();
    }

    /// Waits until the program waits for a missing topic.
    pub fn await_watching(&self) {
        let descriptors = format!("/proc/{}/fd", self.child.id());
        let watches = || {
            let entries = fs::read_dir(&descriptors).unwrap().flatten();
            let mut targets = entries.filter_map(|entry| fs::read_link(entry.path()).ok());
            targets.any(|target| target.to_string_lossy().contains("inotify"))
        };
        let start = Instant::now();
        while !watches() {
            assert!(start.elapsed() < LIMIT, "the program waits for no topic");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    pub fn signal(&self, signal: libc::c_int) {
        // SAFETY: kill takes two numbers; a child that was not waited for still has its id.
        assert_eq!(unsafe { libc::kill(self.child.id() as i32, signal) }, 0);
    }

    /// Closes the program's standard input and waits for its end.
    pub fn end(mut self) -> ExitStatus {
        drop(self.input.take());
        let start = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(start.elapsed() < LIMIT, "the program did not end");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A folder of ring topics for programs with fixed topic names.
pub struct TestFolder(pub PathBuf);

impl TestFolder {
    pub fn new() -> TestFolder {
        let path = Path::new("/dev/shm").join(run::unique("c"));
        fs::create_dir(&path).unwrap();
        TestFolder(path)
    }
}

impl Drop for TestFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A unique topic name. Its file is removed on drop.
pub struct TestTopic(pub Topic);

impl TestTopic {
    pub fn new() -> TestTopic {
        TestTopic(Topic::new(&run::unique("c")).unwrap())
    }

    pub fn name(&self) -> &str {
        self.0.name()
    }
}

impl Drop for TestTopic {
    fn drop(&mut self) {
        let _ = fs::remove_file(self.0.path());
    }
}
