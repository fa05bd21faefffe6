//! The entries of a zip, one after the other, and what is in them.

use super::super::tape::Disk;
use flate2::{Crc, Decompress, FlushDecompress, Status};
use std::cell::Cell;
use std::io::{self, Read, Seek, SeekFrom};
use std::rc::Rc;
use zip::read::read_zipfile_from_stream;
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

/// What is wrong with a zip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wrong {
    /// It ends too early: what came before is good.
    Short(String),
    /// Nobody knows since where.
    Bad(String),
}

impl Wrong {
    pub(super) fn said(self) -> String {
        match self {
            Wrong::Short(said) | Wrong::Bad(said) => said,
        }
    }
}

/// What the zip says of one entry.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) size: u64,
    packed: u64,
    crc: u32,
    deflated: bool,
    /// Where it begins in the file, when that is known.
    at: u64,
}

impl Entry {
    fn of<R: Read>(file: &zip::read::ZipFile<'_, R>) -> Result<Entry, Wrong> {
        let name = file.name().to_owned();
        let deflated = match file.compression() {
            CompressionMethod::Stored => false,
            CompressionMethod::Deflated => true,
            other => {
                return Err(Wrong::Bad(format!(
                    "`{name}` is packed with {other}: sigrok packs with deflate"
                )));
            }
        };
        if file.encrypted() {
            return Err(Wrong::Bad(format!("`{name}` is encrypted")));
        }
        Ok(Entry {
            size: file.size(),
            packed: file.compressed_size(),
            crc: file.crc32(),
            at: file.data_start().unwrap_or(0),
            deflated,
            name,
        })
    }
}

/// Where entries come from.
pub(super) enum Archive {
    /// A file: its directory, the last one to come first, has said where they are.
    Listed(Disk, Vec<Entry>),
    /// In the order in which they were written.
    Streamed(Gate),
}

impl Archive {
    /// Reads the directory at the end of a file.
    pub(super) fn listed(disk: Disk) -> Result<(Disk, Vec<Entry>), String> {
        let mut archive = ZipArchive::new(disk.clone()).map_err(|e| said(&e))?;
        let count = archive.len();
        let entry = |at| match archive.by_index_raw(at) {
            Ok(file) => Entry::of(&file).map_err(Wrong::said),
            Err(error) => Err(said(&error)),
        };
        let entries: Result<Vec<Entry>, String> = (0..count).map(entry).collect();
        Ok((disk, entries?))
    }

    pub(super) fn streamed(input: impl Read + 'static) -> Archive {
        Archive::Streamed(Gate {
            input: Box::new(input),
            shut: Rc::default(),
        })
    }

    /// The next entry. Before it is asked for, the one before has been read or skipped.
    pub(super) fn next(&mut self) -> Result<Option<Entry>, Wrong> {
        match self {
            Archive::Listed(disk, entries) => {
                let Some(entry) = entries.pop() else {
                    return Ok(None);
                };
                disk.seek(SeekFrom::Start(entry.at)).map_err(|e| read(&e))?;
                Ok(Some(entry))
            }
            Archive::Streamed(gate) => gate.next(),
        }
    }

    /// Back to the beginning of an entry, where that is possible.
    pub(super) fn again(&mut self, entry: &Entry) -> Result<bool, Wrong> {
        match self {
            Archive::Listed(disk, _) => {
                disk.seek(SeekFrom::Start(entry.at)).map_err(|e| read(&e))?;
                Ok(true)
            }
            Archive::Streamed(_) => Ok(false),
        }
    }

    /// Goes past an entry that nobody wants.
    pub(super) fn skip(&mut self, entry: &Entry) -> Result<(), Wrong> {
        let Archive::Streamed(gate) = self else {
            return Ok(());
        };
        let mut packed = (&mut gate.input).take(entry.packed);
        let skipped = io::copy(&mut packed, &mut io::sink()).map_err(|e| read(&e))?;
        if skipped < entry.packed {
            return Err(Wrong::Short(CUT.to_owned()));
        }
        Ok(())
    }

    pub(super) fn input(&mut self) -> &mut dyn Read {
        match self {
            Archive::Listed(disk, _) => disk,
            Archive::Streamed(gate) => &mut gate.input,
        }
    }
}

/// What headers of entries are read from. The library skips an entry that it has read the header of: shut, it finds nothing
/// to skip.
pub(super) struct Gate {
    input: Box<dyn Read>,
    shut: Rc<Cell<bool>>,
}

impl Gate {
    fn next(&mut self) -> Result<Option<Entry>, Wrong> {
        let shut = Rc::clone(&self.shut);
        shut.set(false);
        let entry = match read_zipfile_from_stream(self) {
            Ok(Some(file)) => {
                shut.set(true);
                Entry::of(&file).map(Some)
            }
            Ok(None) => Ok(None),
            Err(ZipError::Io(error)) => Err(read(&error)),
            Err(ZipError::UnsupportedArchive(said)) if said.contains("local header") => {
                let said =
                    "how long an entry is stands behind it: save it to a file, and read that";
                Err(Wrong::Bad(said.to_owned()))
            }
            Err(error) => Err(Wrong::Bad(said(&error))),
        };
        shut.set(true);
        if let Ok(None) = entry {
            // All samples have come. Whoever writes to the pipe is let finish.
            drop(io::copy(&mut self.input, &mut io::sink()));
        }
        entry
    }
}

impl Read for Gate {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.shut.get() {
            return Ok(0);
        }
        self.input.read(buffer)
    }
}

fn said(error: &ZipError) -> String {
    match error {
        ZipError::Io(error) => read(error).said(),
        ZipError::InvalidArchive(said) => format!("it is no whole zip ({said}): is it cut short?"),
        other => other.to_string(),
    }
}

fn read(error: &io::Error) -> Wrong {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Wrong::Short(CUT.to_owned()),
        _ => Wrong::Short(error.to_string()),
    }
}

const CUT: &str = "the file ends there: it is cut short";

/// Packed bytes at once.
const PACKED: usize = 32 << 10;

/// An entry as it is read.
pub(super) struct Body {
    pub(super) entry: Entry,
    inflate: Option<Decompress>,
    crc: Crc,
    buffer: Vec<u8>,
    from: usize,
    to: usize,
    /// Packed bytes that have not been read.
    left: u64,
    /// Bytes that came out.
    pub(super) out: u64,
    ended: bool,
}

impl Body {
    pub(super) fn new(entry: Entry) -> Body {
        Body {
            inflate: entry.deflated.then(|| Decompress::new(false)),
            crc: Crc::new(),
            buffer: vec![0; PACKED],
            from: 0,
            to: 0,
            left: entry.packed,
            out: 0,
            ended: false,
            entry,
        }
    }

    /// Reads on. 0 is the end, and that everything before it was as the zip says.
    pub(super) fn read(&mut self, input: &mut dyn Read, out: &mut [u8]) -> Result<usize, Wrong> {
        while !self.ended {
            if self.from == self.to && self.left > 0 {
                self.fill(input)?;
            }
            let (used, made) = self.unpack(out)?;
            self.from += used;
            self.out += made as u64;
            self.crc.update(&out[..made]);
            if self.out > self.entry.size {
                let size = self.entry.size;
                return Err(Wrong::Bad(format!(
                    "more comes out than the {size} bytes that the zip speaks of"
                )));
            }
            if made > 0 {
                return Ok(made);
            }
            if used == 0 && !self.ended {
                return Err(Wrong::Bad("its packed data have no end".to_owned()));
            }
        }
        self.check()?;
        Ok(0)
    }

    fn fill(&mut self, input: &mut dyn Read) -> Result<(), Wrong> {
        let most = usize::try_from(self.left).map_or(PACKED, |left| left.min(PACKED));
        let n = loop {
            match input.read(&mut self.buffer[..most]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(0) => return Err(Wrong::Short(CUT.to_owned())),
                Ok(n) => break n,
                Err(error) => return Err(read(&error)),
            }
        };
        (self.from, self.to) = (0, n);
        self.left -= n as u64;
        Ok(())
    }

    /// How many bytes went in and came out.
    fn unpack(&mut self, out: &mut [u8]) -> Result<(usize, usize), Wrong> {
        let packed = &self.buffer[self.from..self.to];
        let Some(inflate) = &mut self.inflate else {
            let n = packed.len().min(out.len());
            out[..n].copy_from_slice(&packed[..n]);
            self.ended = self.left == 0 && n == packed.len();
            return Ok((n, n));
        };
        let (before_in, before_out) = (inflate.total_in(), inflate.total_out());
        let status = inflate.decompress(packed, out, FlushDecompress::None);
        let status =
            status.map_err(|error| Wrong::Bad(format!("its packed data are broken: {error}")))?;
        self.ended = status == Status::StreamEnd;
        let used = inflate.total_in() - before_in;
        let made = inflate.total_out() - before_out;
        Ok((used as usize, made as usize))
    }

    fn check(&self) -> Result<(), Wrong> {
        let said = if self.out < self.entry.size {
            let (out, size) = (self.out, self.entry.size);
            format!("{out} bytes come out, the zip speaks of {size}")
        } else if self.left > 0 || self.from < self.to {
            "there is more behind the end of its packed data".to_owned()
        } else if self.crc.sum() != self.entry.crc {
            "its checksum is wrong: something in it is not as it was written".to_owned()
        } else {
            return Ok(());
        };
        Err(Wrong::Bad(said))
    }
}
