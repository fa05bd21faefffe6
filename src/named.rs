//! Which files have encoders by name, and what they say.

use biss::config::{Config, Encoder, MOST_BYTES};
use biss::parse::nearest;
use std::env;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Read after the user's own.
const SYSTEM: &str = "/etc/biss.toml";

/// Where encoders are looked for. The first file that has a name decides.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Files {
    paths: Vec<PathBuf>,
    /// Named by the user, so it has to be there.
    given: bool,
}

/// An encoder, and the file that has it.
#[derive(Clone, Debug)]
pub(crate) struct Named {
    pub(crate) file: PathBuf,
    pub(crate) name: String,
    pub(crate) encoder: Encoder,
}

/// Why there is no such encoder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Unfound {
    /// No file has it; what they have.
    Nobody(String),
    /// A file cannot be read.
    Wrong(String),
}

impl Files {
    /// The one of `--config`, or the usual ones.
    pub(crate) fn of(given: Option<&Path>) -> Files {
        match given {
            Some(path) => Files {
                paths: vec![path.to_owned()],
                given: true,
            },
            None => Files {
                paths: own().into_iter().chain([PathBuf::from(SYSTEM)]).collect(),
                given: false,
            },
        }
    }

    /// The encoder of that name.
    ///
    /// # Errors
    /// What is wrong with a file, or that none has it.
    pub(crate) fn find(&self, name: &str) -> Result<Encoder, Unfound> {
        let mut others = Vec::new();
        for path in &self.paths {
            let config = self.read(path).map_err(Unfound::Wrong)?;
            if let Some(encoder) = config.encoder(name) {
                return Ok(encoder.clone());
            }
            let more = config.encoders().map(|(name, _)| name.to_owned());
            others.extend(
                more.filter(|name| !others.contains(name))
                    .collect::<Vec<_>>(),
            );
        }
        Err(Unfound::Nobody(self.others(name, &others)))
    }

    /// All encoders, by name, and what is wrong with files.
    pub(crate) fn all(&self) -> (Vec<Named>, Vec<(PathBuf, String)>) {
        let (mut all, mut wrong): (Vec<Named>, _) = (Vec::new(), Vec::new());
        for path in &self.paths {
            match self.read(path) {
                Ok(config) => {
                    for (name, encoder) in config.encoders() {
                        if all.iter().all(|known| known.name != name) {
                            all.push(Named {
                                file: path.clone(),
                                name: name.to_owned(),
                                encoder: encoder.clone(),
                            });
                        }
                    }
                }
                Err(error) => wrong.push((path.clone(), error)),
            }
        }
        all.sort_by(|a, b| a.name.cmp(&b.name));
        (all, wrong)
    }

    /// Nothing where there is no file.
    fn read(&self, path: &Path) -> Result<Config, String> {
        let shown = path.display();
        let bytes = match bytes(path) {
            Ok(bytes) => bytes,
            Err(error) if !self.given && is_absent(&error) => return Ok(Config::default()),
            Err(error) => {
                return Err(format!(
                    "reading {shown}: {error}\n  named encoders stand there; --config names another file"
                ));
            }
        };
        Config::parse(&bytes).map_err(|error| format!("{shown}:{error}"))
    }

    fn others(&self, name: &str, others: &[String]) -> String {
        let paths = self.paths.iter().map(|path| path.display().to_string());
        let paths = paths.collect::<Vec<_>>().join(" and ");
        let others: Vec<&str> = others.iter().map(String::as_str).collect();
        match (nearest(name, &others), &others[..]) {
            (_, []) => {
                format!("an encoder of that name would stand in {paths}, where there is none")
            }
            (Some(meant), _) => format!("of the encoders in {paths} `{meant}` is the nearest"),
            (None, others) => format!("encoders in {paths} are {}", others.join(" ")),
        }
    }
}

/// Where an encoder is saved: in the file of `--config`, or the user's own. None where nobody says where that would be.
pub(crate) fn to_write(given: Option<&Path>) -> Option<PathBuf> {
    given.map(Path::to_owned).or_else(own)
}

/// The user's own file, where the environment says where that would be.
fn own() -> Option<PathBuf> {
    let folder = |name| {
        let path = env::var_os(name).map(PathBuf::from);
        path.filter(|path| path.is_absolute())
    };
    let home = || folder("HOME").map(|home| home.join(".config"));
    let folder = folder("XDG_CONFIG_HOME").or_else(home)?;
    Some(folder.join("biss/config.toml"))
}

fn is_absent(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
    )
}

/// A little more than a configuration may have, whatever there is.
fn bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let file = File::open(path)?;
    file.take(MOST_BYTES as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_first_file_that_has_a_name_decides() {
        let folder = env::temp_dir().join(format!("biss-named-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (mine, system) = (folder.join("mine.toml"), folder.join("biss.toml"));
        let files = Files {
            paths: vec![mine.clone(), system.clone()],
            given: false,
        };
        let found = |files: &Files, name: &str| match files.find(name) {
            Ok(encoder) => encoder.link,
            Err(Unfound::Nobody(said) | Unfound::Wrong(said)) => said,
        };
        let find = |name: &str| found(&files, name);
        let none = find("x");
        assert!(
            none.contains("mine.toml") && none.contains("none"),
            "{none}"
        );
        fs::write(
            &system,
            "encoder.x.link = 'sim'\nencoder.y.link = 'sim:ack=2'\n",
        )
        .unwrap();
        assert_eq!(find("x"), "sim");
        fs::write(&mine, "[encoder.x]\nlink = 'sim:ack=3'\n").unwrap();
        assert_eq!(find("x"), "sim:ack=3");
        assert_eq!(find("y"), "sim:ack=2");
        assert!(find("yy").contains("`y` is the nearest"), "{}", find("yy"));
        assert!(find("other").ends_with("are x y"), "{}", find("other"));
        let (all, wrong) = files.all();
        let shown: Vec<_> = all
            .iter()
            .map(|named| (named.name.as_str(), &named.file))
            .collect();
        assert_eq!(shown, [("x", &mine), ("y", &system)]);
        assert!(wrong.is_empty());
        // What is wrong in the first one is told before the second one is asked.
        fs::write(&mine, "[encoder.x]\nlnk = 'sim'\n").unwrap();
        let said = find("y");
        assert!(
            said.contains("mine.toml:2: encoder.x.lnk: no such key, `link` is meant"),
            "{said}"
        );
        let (all, wrong) = files.all();
        assert_eq!((all.len(), wrong.len()), (2, 1));
        let given = Files::of(Some(&folder.join("none.toml")));
        let said = found(&given, "x");
        assert!(
            said.starts_with("reading ") && said.contains("none.toml: No such file"),
            "{said}"
        );
        assert!(Files::of(Some(&folder)).find("x").is_err(), "a folder");
        let endless = found(&Files::of(Some(Path::new("/dev/zero"))), "x");
        assert!(endless.contains("more than"), "{endless}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
