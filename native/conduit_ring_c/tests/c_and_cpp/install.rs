//! Programs build and run against the installation and the build tree, with pkg-config and CMake.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::toolchain::{
    Language, Process, TestFolder, built_dir, fresh_folder, has, home, skip, succeed,
};

/// Installs once per run.
fn prefix() -> &'static Path {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        let prefix = fresh_folder("prefix");
        let mut install = Command::new(home().join("install.sh"));
        succeed(
            install
                .arg("--prefix")
                .arg(&prefix)
                .arg("--built")
                .arg(built_dir()),
        );
        prefix
    })
}

fn needs(program: &str) -> bool {
    let there = has(program);
    if !there {
        skip(&format!("no {program} (Debian's package {program})"));
    }
    there
}

/// Runs the C examples, publisher and subscriber.
fn exchange(publish: &Path, subscribe: &Path, library_path: &Path) {
    let topics = TestFolder::new();
    let start = |program: &Path| {
        let mut command = Command::new(program);
        command.env("LD_LIBRARY_PATH", library_path);
        command.env("CONDUIT_RING_DIR", &topics.0);
        Process::start(command)
    };
    let mut subscriber = start(subscribe);
    // Messages published before it has subscribed do not reach it.
    subscriber.await_watching();
    let mut publisher = start(publish);
    for n in 0..10 {
        publisher.expect(&format!("published message {n}"));
        subscriber.expect(&format!("{n}: number {n} (0 lost before)"));
    }
    assert!(publisher.end().success());
    assert!(subscriber.end().success());
}

fn pkg_config(arguments: &[&str]) -> Vec<String> {
    let mut command = Command::new("pkg-config");
    command
        .env("PKG_CONFIG_PATH", prefix().join("lib/pkgconfig"))
        .args(arguments)
        .arg("conduit_ring");
    let output = succeed(&mut command).stdout;
    String::from_utf8(output)
        .unwrap()
        .split_whitespace()
        .map(str::to_owned)
        .collect()
}

#[test]
fn the_examples_build_and_run_by_pkg_config() {
    if !needs("pkg-config")
        || Language::C.compile().is_none()
        || Language::Cpp.compile().is_none()
    {
        return;
    }
    assert_eq!(pkg_config(&["--modversion"]), [env!("CARGO_PKG_VERSION")]);
    let to = fresh_folder("pkg-config");
    for entry in fs::read_dir(home().join("examples")).unwrap() {
        let source = entry.unwrap().path();
        let language = match source.extension().and_then(|e| e.to_str()) {
            Some("c") => Language::C,
            Some("cpp") => Language::Cpp,
            _ => continue,
        };
        succeed(
            language
                .compile()
                .unwrap()
                .arg(&source)
                .args(pkg_config(&["--cflags", "--libs"]))
                .arg("-o")
                .arg(to.join(source.file_stem().unwrap())),
        );
    }
    exchange(
        &to.join("publish"),
        &to.join("subscribe"),
        &prefix().join("lib"),
    );
}

#[test]
fn the_programs_of_the_guide_compile() {
    let guide = fs::read_to_string(home().join("../../docs/guides/cpp.md")).unwrap();
    let programs: Vec<&str> = guide
        .split("```cpp")
        .skip(1)
        .map(|rest| rest.split_once('\n').unwrap().1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert!(!programs.is_empty());
    for program in programs {
        let Some(mut compile) = Language::Cpp.compile() else {
            return;
        };
        let source = fresh_folder("guide").join("program.cpp");
        fs::write(&source, program).unwrap();
        succeed(compile.arg("-fsyntax-only").arg(&source));
    }
}

/// As in a project that was written for the C++ headers.
const CORE_PROJECT: &str = "\
cmake_minimum_required(VERSION 3.19)
project(user LANGUAGES C CXX)
find_package(conduit_core REQUIRED)
add_executable(talker ${EXAMPLES}/string_publisher.cpp)
target_link_libraries(talker PRIVATE conduit_core::conduit_core)
add_executable(listener ${EXAMPLES}/string_subscriber.cpp)
target_link_libraries(listener PRIVATE conduit::conduit_core)
add_executable(camera ${EXAMPLES}/camera_publisher.cpp)
target_link_libraries(camera PRIVATE conduit_core)
";

const PROJECT: &str = "\
cmake_minimum_required(VERSION 3.19)
project(user LANGUAGES C CXX)
find_package(conduit_ring 0.1 REQUIRED)
add_executable(talker ${EXAMPLES}/string_publisher.cpp)
target_link_libraries(talker PRIVATE conduit_core)
add_executable(publish ${EXAMPLES}/publish.c)
target_link_libraries(publish PRIVATE conduit_ring::conduit_ring)
add_executable(subscribe ${EXAMPLES}/subscribe.c)
target_link_libraries(subscribe PRIVATE conduit_ring::conduit_ring_static)
";

fn configure(source: &Path, build: &Path, definitions: &[String]) {
    let mut command = Command::new("cmake");
    command.arg("-S").arg(source).arg("-B").arg(build);
    succeed(command.args(definitions));
}

fn cmake_build(build: &Path) {
    succeed(Command::new("cmake").arg("--build").arg(build));
}

#[test]
fn a_cmake_project_finds_the_installation() {
    if !needs("cmake") || Language::Cpp.compile().is_none() {
        return;
    }
    let project = fresh_folder("cmake-user");
    fs::write(project.join("CMakeLists.txt"), PROJECT).unwrap();
    let build = project.join("build");
    let definitions = [
        format!("-DCMAKE_PREFIX_PATH={}", prefix().display()),
        format!("-DEXAMPLES={}", home().join("examples").display()),
    ];
    configure(&project, &build, &definitions);
    cmake_build(&build);
    assert!(build.join("publish").exists() && build.join("subscribe").exists());
    assert!(build.join("talker").exists());

    build_core_project("cmake-user-of-core", &definitions);
}

fn build_core_project(name: &str, definitions: &[String]) {
    let project = fresh_folder(name);
    fs::write(project.join("CMakeLists.txt"), CORE_PROJECT).unwrap();
    let build = project.join("build");
    configure(&project, &build, definitions);
    cmake_build(&build);
    assert!(build.join("talker").exists() && build.join("listener").exists());
    assert!(build.join("camera").exists());
}

#[test]
fn a_cmake_project_finds_the_build_tree() {
    if !needs("cmake") || Language::Cpp.compile().is_none() {
        return;
    }
    let ring = fresh_folder("cmake-ring");
    let built = format!("-DCONDUIT_RING_BUILT={}", built_dir().display());
    configure(
        home(),
        &ring,
        &[built, "-DCONDUIT_RING_EXAMPLES=OFF".to_owned()],
    );
    cmake_build(&ring);

    let project = fresh_folder("cmake-user-of-tree");
    let any_version = PROJECT.replace("conduit_ring 0.1", "conduit_ring");
    fs::write(project.join("CMakeLists.txt"), any_version).unwrap();
    let build = project.join("build");
    let definitions = [
        format!("-Dconduit_ring_DIR={}", ring.display()),
        format!("-DEXAMPLES={}", home().join("examples").display()),
    ];
    configure(&project, &build, &definitions);
    cmake_build(&build);
    assert!(build.join("talker").exists());

    let definitions = [
        format!("-Dconduit_core_DIR={}", ring.display()),
        format!("-DEXAMPLES={}", home().join("examples").display()),
    ];
    build_core_project("cmake-user-of-core-in-tree", &definitions);
}

#[test]
fn a_usage_error_of_the_installer_is_one_line() {
    for wrong in [&["--to", "/x"][..], &["--prefix"], &[]] {
        let output = Command::new(home().join("install.sh"))
            .args(wrong)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
        assert_eq!(output.stderr.iter().filter(|b| **b == b'\n').count(), 1);
    }
}
