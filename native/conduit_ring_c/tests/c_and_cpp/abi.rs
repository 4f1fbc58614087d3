//! The header and the Rust sources agree.
//!
//! Signatures, structs, constants and error numbers are read from the Rust sources, written in C,
//! and compiled together with the header: a different signature is a conflicting declaration, a
//! different struct or constant a failed assertion.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;

use crate::toolchain::{self, Language, folder, home, succeed};

/// Returns the sources with white space collapsed.
fn rust() -> String {
    let mut files: Vec<_> = fs::read_dir(home().join("src"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    let text: String = files
        .iter()
        .map(|f| fs::read_to_string(f).unwrap())
        .collect();
    let code: String = text
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .flat_map(|line| [line, " "])
        .collect();
    code.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn header() -> String {
    fs::read_to_string(home().join("include/conduit_ring.h")).unwrap()
}

/// Returns the text between each `open` and the next `close`.
fn all_between<'a>(
    text: &'a str,
    open: &'a str,
    close: &'a str,
) -> impl Iterator<Item = &'a str> {
    text.split(open)
        .skip(1)
        .map(move |rest| rest.split(close).next().unwrap())
}

/// Translates a type: `*const T` becomes `T const *`.
fn c_type(rust: &str) -> String {
    let rust = rust.trim();
    if let Some(to) = rust.strip_prefix("*const ") {
        return format!("{} const *", c_type(to));
    }
    if let Some(to) = rust.strip_prefix("*mut ") {
        return format!("{} *", c_type(to));
    }
    match rust.rsplit("::").next().unwrap() {
        "c_int" => "int",
        "c_char" => "char",
        "c_void" => "void",
        "bool" => "bool",
        "usize" => "size_t",
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "i64" => "int64_t",
        handle if handle.starts_with("conduit_ring_") => handle,
        other => panic!("expected a type of the C ABI, got: {other:?}"),
    }
    .to_owned()
}

/// Splits `name: type, …` into pairs of C declarator and type.
fn fields(list: &str) -> Vec<(String, String)> {
    list.split(',')
        .map(str::trim)
        .filter(|field| !field.is_empty())
        .map(|field| {
            let (name, of) = field.trim_start_matches("pub ").split_once(':').unwrap();
            match of
                .trim()
                .strip_prefix('[')
                .and_then(|of| of.split_once(';'))
            {
                Some((of, n)) => (
                    format!("{name}[{}]", n.trim_end_matches(']').trim()),
                    c_type(of),
                ),
                None => (name.to_owned(), c_type(of)),
            }
        })
        .collect()
}

/// Returns name and C declaration of each exported function.
fn functions(rust: &str) -> Vec<(String, String)> {
    all_between(rust, "extern \"C\" fn ", " {")
        .map(|signature| {
            let (name, rest) = signature.split_once('(').unwrap();
            let (list, result) = rest.split_once(')').unwrap();
            let result = result
                .trim()
                .strip_prefix("->")
                .map_or("void".to_owned(), c_type);
            let list: Vec<_> = fields(list)
                .into_iter()
                .map(|(name, of)| format!("{of} {name}"))
                .collect();
            let list = if list.is_empty() {
                "void".to_owned()
            } else {
                list.join(", ")
            };
            (name.to_owned(), format!("{result} {name}({list});"))
        })
        .collect()
}

fn structs(rust: &str) -> Vec<(&str, Vec<(String, String)>)> {
    all_between(rust, "#[repr(C)]", "}")
        .map(|rest| {
            let (before, list) = rest.split_once('{').unwrap();
            (before.split("struct ").nth(1).unwrap().trim(), fields(list))
        })
        .collect()
}

fn constants(rust: &str) -> Vec<(&str, &str)> {
    all_between(rust, "pub const CONDUIT_RING_", ";")
        .map(|constant| {
            let (name, rest) = constant.split_once(':').unwrap();
            (name, rest.split_once('=').unwrap().1.trim())
        })
        .collect()
}

fn translate_to_c(rust: &str) -> String {
    let mut c = "#include <conduit_ring.h>\n#include <errno.h>\n".to_owned();
    for constant in all_between(rust, "pub(crate) const E", ";") {
        let (name, value) = constant.split_once(": c_int = ").unwrap();
        writeln!(c, "_Static_assert(E{name} == {value}, \"E{name}\");").unwrap();
    }
    for (_, declaration) in functions(rust) {
        writeln!(c, "{declaration}").unwrap();
    }
    for (name, fields) in structs(rust) {
        writeln!(c, "struct rust_{name} {{").unwrap();
        for (field, of) in &fields {
            writeln!(c, "  {of} {field};").unwrap();
        }
        writeln!(
            c,
            "}};\n_Static_assert(sizeof(struct rust_{name}) == sizeof({name}), \"{name}\");"
        )
        .unwrap();
        for (field, _) in &fields {
            let field = field.split('[').next().unwrap();
            writeln!(
                c,
                "_Static_assert(offsetof(struct rust_{name}, {field}) == \
                 offsetof({name}, {field}), \"{name}.{field}\");\n\
                 _Static_assert(_Generic(&(({name} *)0)->{field}, \
                 __typeof__(&((struct rust_{name} *)0)->{field}): 1, default: 0), \
                 \"{name}.{field}\");"
            )
            .unwrap();
        }
    }
    for (name, value) in constants(rust) {
        let value = if value == "u64::MAX" {
            "UINT64_MAX".to_owned()
        } else {
            value.replace('_', "")
        };
        writeln!(
            c,
            "_Static_assert(CONDUIT_RING_{name} == {value}, \"CONDUIT_RING_{name}\");"
        )
        .unwrap();
    }
    c
}

#[test]
fn signatures_structs_and_constants_of_the_header_are_those_of_the_library() {
    let Some(mut compile) = Language::C.compile() else {
        return;
    };
    let source = folder("abi").join("translated.c");
    fs::write(&source, translate_to_c(&rust())).unwrap();
    // typeof is not in C11; -pedantic accepts the alternate keyword.
    succeed(compile.arg("-fsyntax-only").arg(&source));
}

#[test]
fn the_header_declares_what_the_library_has_and_nothing_else() {
    let declared: BTreeSet<String> = header()
        .split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '('))
        .filter_map(|word| word.split_once('('))
        .map(|(name, _)| name.to_owned())
        .filter(|name| name.starts_with("conduit_ring_"))
        .collect();
    let rust = rust();
    let exported: BTreeSet<String> = functions(&rust).into_iter().map(|(name, _)| name).collect();
    assert_eq!(declared, exported);

    let header = header();
    let defined: BTreeSet<&str> = all_between(&header, "#define CONDUIT_RING_", "\n")
        .filter_map(|rest| rest.split_whitespace().next())
        .filter(|name| !name.ends_with("_INIT") && *name != "H")
        .collect();
    let constants: BTreeSet<&str> = constants(&rust).into_iter().map(|(name, _)| name).collect();
    assert_eq!(defined, constants);

    let types: BTreeSet<&str> = all_between(&header, "typedef struct ", " ").collect();
    for (name, _) in structs(&rust) {
        assert!(types.contains(name), "{name}");
    }
}

#[test]
fn a_c_program_uses_every_function() {
    let cases = fs::read_to_string(home().join("tests/c_and_cpp/programs/cases.c")).unwrap();
    for (name, _) in functions(&rust()) {
        assert!(
            cases.contains(&format!("{name}(")),
            "{name} is not used in cases.c"
        );
    }
}

#[test]
fn the_soname_carries_the_version_of_the_abi() {
    let version = conduit_ring_c::CONDUIT_RING_ABI_VERSION;
    let soname = format!("libconduit_ring.so.{version}");
    for file in [
        "build.rs",
        "install.sh",
        "CMakeLists.txt",
        "cmake/conduit_ring-targets.cmake",
    ] {
        let text = fs::read_to_string(home().join(file)).unwrap();
        assert!(text.contains(&soname), "{file} does not name {soname}");
    }
}

#[test]
fn each_header_compiles_alone() {
    let headers = [
        "conduit_core/pubsub.hpp",
        "conduit_core/node.hpp",
        "conduit_core/log.hpp",
        "conduit_core/message.hpp",
        "conduit_ring.h",
    ];
    for header in headers {
        let Some(mut compile) = Language::Cpp.compile() else {
            return;
        };
        let source = folder("headers").join("alone.cpp");
        fs::write(
            &source,
            format!("#include <{header}>\n#include <{header}>\n"),
        )
        .unwrap();
        let pickier = [
            "-Wconversion",
            "-Wshadow",
            "-Wold-style-cast",
            "-Wnon-virtual-dtor",
        ];
        succeed(compile.args(pickier).arg("-fsyntax-only").arg(&source));
    }
    let Some(mut compile) = Language::C.compile() else {
        return;
    };
    succeed(
        compile
            .args(["-Wconversion", "-Wstrict-prototypes", "-fsyntax-only"])
            .arg(toolchain::include_dir().join("conduit_ring.h")),
    );
}
