//! `.sr`, sigrok's session files, version 2, as libsigrok writes them (its `src/output/srzip.c`): a zip archive with `version`,
//! `metadata` and the samples in `logic-1-1`, `logic-1-2` …, a byte each.
//!
//! The archive gets its directory anew with every piece of samples. A piece that does not fit is taken back, so that a disk
//! that is full leaves all pieces before it.

use super::{Head, Output, Recorder, sample};
use crate::unit::Hertz;
use crate::waveform::Change;
use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::rc::Rc;
use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Samples of a piece: at first few, so that little is lost, then more, so that the directory stays small.
const PIECE: std::ops::RangeInclusive<u64> = 1 << 22..=1 << 28;

/// Samples handed on at once.
const BLOCK: usize = 1 << 16;

pub(super) struct Sr {
    archive: Archive,
    rate: Hertz,
    first_ns: u64,
    /// What the wires show now.
    byte: u8,
    /// Samples so far.
    samples: u64,
    block: Vec<u8>,
    /// Samples that the open piece still takes; none where no piece is open.
    room: u64,
    pieces: u64,
}

impl Sr {
    pub(super) fn begin(output: Output, head: &Head) -> io::Result<Sr> {
        let mut archive = Archive::new(output);
        archive.add("version", b"2")?;
        let metadata = format!(
            "[global]\n\
             sigrok version=0.5.2\n\
             \n\
             [device 1]\n\
             capturefile=logic-1\n\
             total probes=2\n\
             samplerate={}\n\
             total analog=0\n\
             probe1=MA\n\
             probe2=SLO\n\
             unitsize=1\n",
            rate(head.rate)
        );
        archive.add("metadata", metadata.as_bytes())?;
        archive.close()?;
        Ok(Sr {
            archive,
            rate: head.rate,
            first_ns: head.first.t_ns,
            byte: byte(&head.first),
            samples: 0,
            block: Vec::with_capacity(BLOCK),
            room: 0,
            pieces: 0,
        })
    }

    /// The levels stay as they are up to sample `sample`.
    fn hold(&mut self, sample: u64) -> io::Result<()> {
        while self.samples < sample {
            if self.room == 0 {
                self.piece()?;
            }
            let space = (BLOCK - self.block.len()) as u64;
            let run = (sample - self.samples).min(space).min(self.room);
            self.block
                .resize(self.block.len() + run as usize, self.byte);
            self.samples += run;
            self.room -= run;
            if self.block.len() == BLOCK || self.room == 0 {
                self.hand_on()?;
            }
            if self.room == 0 {
                self.archive.close()?;
            }
        }
        Ok(())
    }

    fn hand_on(&mut self) -> io::Result<()> {
        let written = self.archive.write(&self.block);
        self.block.clear();
        written
    }

    fn piece(&mut self) -> io::Result<()> {
        self.room = (self.samples / 16).clamp(*PIECE.start(), *PIECE.end());
        self.pieces += 1;
        self.archive.open(&format!("logic-1-{}", self.pieces))
    }
}

/// As libsigrok prints it, and reads it.
fn rate(rate: Hertz) -> String {
    match rate.0 {
        hz if hz % 1_000_000_000 == 0 => format!("{} GHz", hz / 1_000_000_000),
        hz if hz % 1_000_000 == 0 => format!("{} MHz", hz / 1_000_000),
        hz if hz % 1_000 == 0 => format!("{} kHz", hz / 1_000),
        hz => format!("{hz} Hz"),
    }
}

fn byte(change: &Change) -> u8 {
    u8::from(change.ma) | u8::from(change.slo == Some(true)) << 1
}

impl Recorder for Sr {
    /// It shows with the first sample that is not before it.
    fn change(&mut self, change: &Change) -> io::Result<()> {
        let since_ns = change.t_ns.saturating_sub(self.first_ns);
        self.hold(sample(self.rate, since_ns))?;
        self.byte = byte(change);
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn end(&mut self, t_ns: u64) -> io::Result<()> {
        let since = u128::from(t_ns.saturating_sub(self.first_ns)) * u128::from(self.rate.0);
        let last = u64::try_from(since / 1_000_000_000).unwrap_or(u64::MAX);
        self.hold(last.saturating_add(1))?;
        if self.room > 0 {
            self.hand_on()?;
            self.room = 0;
            self.archive.close()?;
        }
        self.archive.end()
    }
}

/// A zip archive that can be read whenever no entry is open.
enum Archive {
    File {
        file: File,
        /// While an entry is open.
        zip: Option<ZipWriter<Guarded<File>>>,
        trouble: Trouble,
        /// Where the directory begins while no entry is open, and what it is.
        directory: (u64, Vec<u8>),
    },
    /// What went into a pipe stays there.
    Stream {
        zip: Option<ZipWriter<Pipe>>,
        trouble: Trouble,
    },
}

/// The first error of a writer, from when on it takes everything and writes nothing: the archiver need not clean up then.
type Trouble = Rc<RefCell<Option<io::Error>>>;

type Pipe = StreamWriter<Guarded<Box<dyn Write>>>;

struct Guarded<W> {
    inner: W,
    trouble: Trouble,
}

impl<W: Write> Write for Guarded<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.trouble.borrow().is_some() {
            return Ok(bytes.len());
        }
        match self.inner.write(bytes) {
            Err(error) if error.kind() != io::ErrorKind::Interrupted => {
                *self.trouble.borrow_mut() = Some(error);
                Ok(bytes.len())
            }
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.trouble.borrow().is_some() {
            true => Ok(()),
            false => self.inner.flush(),
        }
    }
}

impl<W: Read> Read for Guarded<W> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.inner.read(bytes)
    }
}

impl<W: Seek> Seek for Guarded<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

fn options() -> SimpleFileOptions {
    SimpleFileOptions::default().compression_method(CompressionMethod::Deflated)
}

impl Archive {
    fn new(output: Output) -> Archive {
        let trouble = Trouble::default();
        match output {
            Output::File(file) => Archive::File {
                file,
                zip: None,
                trouble,
                directory: (0, Vec::new()),
            },
            Output::Stream(inner) => {
                let guarded = Guarded {
                    inner,
                    trouble: Rc::clone(&trouble),
                };
                Archive::Stream {
                    zip: Some(ZipWriter::new_stream(guarded)),
                    trouble,
                }
            }
        }
    }

    fn add(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.open(name)?;
        self.write(bytes)
    }

    fn open(&mut self, name: &str) -> io::Result<()> {
        let begun = match self {
            Archive::File {
                file,
                zip,
                trouble,
                directory,
            } => {
                if zip.is_none() {
                    let guarded = Guarded {
                        inner: file.try_clone()?,
                        trouble: Rc::clone(trouble),
                    };
                    *zip = Some(match directory {
                        (0, _) => ZipWriter::new(guarded),
                        (at, _) => {
                            let zip = ZipWriter::new_append(guarded)?;
                            // In the directory's place, not behind it: readers of pipes, and of files that were cut short,
                            // take the first directory for the end. The clone shares its place with `file`.
                            file.seek(SeekFrom::Start(*at))?;
                            zip
                        }
                    });
                }
                zip.as_mut().map(|zip| zip.start_file(name, options()))
            }
            Archive::Stream { zip, .. } => zip.as_mut().map(|zip| zip.start_file(name, options())),
        };
        begun.transpose()?;
        self.look()
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Archive::File { zip: Some(zip), .. } => zip.write_all(bytes)?,
            Archive::Stream { zip: Some(zip), .. } => zip.write_all(bytes)?,
            _ => {}
        }
        self.look()
    }

    /// Ends the entry, and writes the directory where there is a way back.
    fn close(&mut self) -> io::Result<()> {
        if let Archive::File { zip, .. } = self {
            if let Some(zip) = zip.take() {
                zip.finish()?;
            }
        }
        self.look()?;
        if let Archive::File {
            file, directory, ..
        } = self
        {
            *directory = read_directory(file)?;
        }
        Ok(())
    }

    fn end(&mut self) -> io::Result<()> {
        if let Archive::Stream { zip, .. } = self {
            if let Some(zip) = zip.take() {
                zip.finish()?.into_inner().flush()?;
            }
        }
        self.look()
    }

    /// Whether something went wrong; then the entry that was open is taken back.
    fn look(&mut self) -> io::Result<()> {
        let (Archive::File { trouble, .. } | Archive::Stream { trouble, .. }) = self;
        let Some(error) = trouble.borrow_mut().take() else {
            return Ok(());
        };
        // Nothing is written any more.
        *trouble.borrow_mut() = Some(io::Error::from(error.kind()));
        if let Archive::File {
            file,
            zip,
            directory: (at, bytes),
            ..
        } = self
        {
            *zip = None;
            // The room that it takes was there before; and the first error is the one to tell of.
            let _ = (|| {
                file.seek(SeekFrom::Start(*at))?;
                file.write_all(bytes)?;
                file.set_len(*at + bytes.len() as u64)
            })();
        }
        Err(error)
    }
}

/// Where the directory of an archive begins, and all from there on.
fn read_directory(file: &mut File) -> io::Result<(u64, Vec<u8>)> {
    let begin = ZipArchive::new(&mut *file)?.central_directory_start();
    file.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok((begin, bytes))
}
