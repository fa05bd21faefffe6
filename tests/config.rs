//! Encoders by name, as files have them.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::config::{Config, Encoder, save};
use biss::unit::Hertz;
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

/// A folder that goes with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("biss-config-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn encoder(link: &str) -> Encoder {
    Encoder {
        link: link.into(),
        frame: Some("st20,nE,nW,crc6".parse().unwrap()),
        clock: Some(Hertz(2_000_000)),
        ..Encoder::default()
    }
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

#[test]
fn a_saved_encoder_is_there_and_nothing_else_has_changed() {
    let folder = Folder::new("save");
    let path = folder.at("a/b/config.toml");
    save(&path, "spindle", &encoder("sim")).unwrap();
    let written =
        "[encoder.spindle]\nlink = \"sim\"\nframe = \"st20,nE,nW,crc6\"\nclock = \"2MHz\"\n";
    assert_eq!(read(&path), written);
    let mode = fs::metadata(folder.at("a")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o700);
    let mine = format!("# mine\n\n{written}# not of the machine\nzero = 77\n");
    fs::write(&path, &mine).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    save(&path, "axis", &encoder("spi:0.0")).unwrap();
    assert!(read(&path).starts_with(&mine), "{}", read(&path));
    let mode = fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o640);
    save(&path, "spindle", &encoder("sim:ack=2")).unwrap();
    let text = read(&path);
    let config = Config::parse(text.as_bytes()).unwrap();
    assert_eq!(config.encoder("spindle"), Some(&encoder("sim:ack=2")));
    assert_eq!(config.encoder("axis"), Some(&encoder("spi:0.0")));
    assert!(text.starts_with("# mine\n\n[encoder.spindle]\n"), "{text}");
    assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn a_link_leads_where_it_did() {
    let folder = Folder::new("link");
    fs::write(folder.at("real.toml"), "").unwrap();
    symlink("real.toml", folder.at("config.toml")).unwrap();
    save(&folder.at("config.toml"), "x", &encoder("sim")).unwrap();
    assert!(
        fs::symlink_metadata(folder.at("config.toml"))
            .unwrap()
            .is_symlink()
    );
    assert!(read(&folder.at("real.toml")).contains("[encoder.x]"));
}

#[test]
fn what_cannot_be_saved_leaves_the_file_alone() {
    let folder = Folder::new("refused");
    let path = folder.at("config.toml");
    let long = "#".repeat(biss::config::MOST_BYTES + 1);
    for (text, name, words) in [
        (
            "[encoder.x]\nclok = 1\n",
            "y",
            "config.toml:2: encoder.x.clok: no such key, `clock`",
        ),
        ("", "sim", "is a kind of link"),
        ("# fine\n", "a/b", "no name for an encoder"),
        (&long, "x", "more text"),
    ] {
        fs::write(&path, text).unwrap();
        let said = save(&path, name, &encoder("sim")).unwrap_err().to_string();
        assert!(said.contains(words) && said.starts_with("saving"), "{said}");
        assert_eq!(read(&path), text);
        assert_eq!(folder.names(), ["config.toml"]);
    }
    fs::write(&path, [0xFF, 0]).unwrap();
    let said = save(&path, "x", &encoder("sim")).unwrap_err().to_string();
    assert!(said.contains("no UTF-8"), "{said}");
    // A folder is no file, and nothing can be made below a file.
    for path in [folder.0.clone(), path.join("config.toml")] {
        assert!(save(&path, "x", &encoder("sim")).is_err());
    }
    assert_eq!(folder.names(), ["config.toml"]);
}
