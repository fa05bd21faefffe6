//! A file with one encoder more, or another one.

use super::{Encoder, MOST_BYTES, with};
use crate::link::Error;
use std::fs::{self, DirBuilder, File};
use std::io::{self, Read, Write};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// Writes an encoder into a configuration, in the place of the one that had its name. All else in the file stays; the
/// folder is made where there is none. The file is replaced at once, so that nobody ever sees half of it.
///
/// # Errors
/// When the file cannot be read or written, or is no configuration.
pub fn save(path: &Path, name: &str, encoder: &Encoder) -> Result<(), Error> {
    let doing = format!("saving {name} in {}", path.display());
    let said = |error: io::Error| {
        let hint = "is there room, and may you write there? --config names another file";
        Error::new(&doing, error, hint)
    };
    let old = read(path).map_err(said)?;
    let text = with(&old, name, encoder).map_err(|error| {
        Error::new(
            &doing,
            format_args!("{}:{error}", path.display()),
            "nothing was written",
        )
    })?;
    // A link goes on to lead where it does.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if let Some(folder) = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
    {
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o700);
        builder.create(folder).map_err(said)?;
    }
    replace(&path, &text).map_err(said)
}

fn read(path: &Path) -> io::Result<String> {
    let file = match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(String::new()),
        opened => opened?,
    };
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("no file of its own"));
    }
    let mut bytes = Vec::new();
    file.take(MOST_BYTES as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > MOST_BYTES {
        return Err(io::Error::other("more text than a configuration has"));
    }
    let no_text = |_| io::Error::other("no UTF-8");
    String::from_utf8(bytes).map_err(no_text)
}

/// A name of our own in the same folder.
fn beside(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}", std::process::id()));
    path.with_file_name(name)
}

fn replace(path: &Path, text: &str) -> io::Result<()> {
    let beside = beside(path);
    let written = write_new(&beside, path, text);
    written.inspect_err(|_| {
        // Its own error would only hide the first one.
        let _ = fs::remove_file(&beside);
    })
}

fn write_new(beside: &Path, path: &Path, text: &str) -> io::Result<()> {
    let mut file = File::create_new(beside)?;
    file.write_all(text.as_bytes())?;
    if let Ok(there) = fs::metadata(path) {
        file.set_permissions(there.permissions())?;
    }
    file.sync_all()?;
    fs::rename(beside, path)
}
