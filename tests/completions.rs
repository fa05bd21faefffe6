//! The committed completions, loaded into the shells that are there. What is not installed is said.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::process::{Command, Stdio};

/// What a shell prints for a script, or nothing when there is no such shell.
fn said(shell: &str, args: &[&str], script: &str) -> Option<String> {
    let output = Command::new(shell)
        .args(args)
        .arg(script)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stdin(Stdio::null())
        .output();
    match output {
        Ok(output) => {
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{shell}: {stderr}");
            Some(String::from_utf8(output.stdout).unwrap())
        }
        Err(_) => {
            let all = std::env::var_os("BISS_TEST_ALL").is_some();
            assert!(!all, "{shell} is not installed");
            println!("{shell} is not installed: its completions are not tried");
            None
        }
    }
}

/// What is typed, and the words that are offered for the last of it.
const TYPED: [(&str, &[&str]); 12] = [
    ("biss re", &["read", "reg"]),
    ("biss reg wa", &["wave:"]),
    ("biss reg sim re", &["read"]),
    ("biss reg sim load --dr", &["--dry-run"]),
    ("biss reg sim dump -o ", &["json", "text"]),
    ("biss command wa", &["wave:"]),
    ("biss read wa", &["wave:"]),
    ("biss read sp", &["spi:"]),
    ("biss read spi:0.0 -o ", &["csv", "json", "text"]),
    ("biss list -o ", &["json", "text"]),
    ("biss read spi:0.0 -f resolute-2", &["resolute-26"]),
    ("biss read spi:0.0 -c ", &[]),
];

fn compare(shell: &str, offered: &dyn Fn(&str) -> Option<Vec<String>>) {
    for (typed, wanted) in TYPED {
        let Some(mut offered) = offered(typed) else {
            return;
        };
        offered.retain(|word| !word.is_empty());
        offered.sort();
        assert_eq!(offered, wanted, "{shell}: {typed}");
    }
}

#[test]
fn bash_completes() {
    compare("bash", &|typed| {
        // As bash calls it: the command, the word, the word before.
        let words: Vec<&str> = typed.split(' ').collect();
        let (last, before) = (words[words.len() - 1], words[words.len() - 2]);
        let script = format!(
            "compopt() {{ :; }}; source completions/biss.bash; COMP_WORDS=({} '{last}'); COMP_CWORD={}; \
             _biss_link biss '{last}' '{before}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
            words[..words.len() - 1].join(" "),
            words.len() - 1
        );
        let said = said("bash", &["--norc", "-c"], &script)?;
        Some(said.lines().map(str::to_owned).collect())
    });
}

#[test]
fn fish_completes() {
    compare("fish", &|typed| {
        let script = format!("source completions/biss.fish; complete -C '{typed}'");
        let said = said("fish", &["--no-config", "-c"], &script)?;
        let word = |line: &str| line.split('\t').next().unwrap().to_owned();
        Some(said.lines().map(word).collect())
    });
}

/// zsh completes at a terminal only; here it reads the file, and the functions are there.
#[test]
fn zsh_takes_the_file() {
    let script =
        "compdef() { print $1 $2 }; source completions/_biss; print $+functions[_biss_read_links]";
    if let Some(said) = said("zsh", &["-f", "-c"], script) {
        assert_eq!(said, "_biss biss\n1\n");
    }
}
