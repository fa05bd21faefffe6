//! Input that can be read from its beginning once more, as far as it was kept.

use std::cell::RefCell;
use std::io::{self, Read, Seek, SeekFrom};
use std::rc::Rc;

/// Input that may come in blocks of its own.
pub trait Blocks: Read {
    /// Reads on, as [`Read::read`] does; `block` may be exchanged for another one, so that nothing has to be copied.
    ///
    /// # Errors
    /// Those of reading.
    fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        self.read(block)
    }
}

/// Input that is copied from.
struct Plain<T>(T);

impl<T: Read> Read for Plain<T> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl<T: Seek> Seek for Plain<T> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

impl<T: Read> Blocks for Plain<T> {}

/// What a recording is read from.
pub struct Input {
    kind: Kind,
}

enum Kind {
    Pipe(Box<dyn Blocks>),
    File(Box<dyn Both>),
}

trait Both: Blocks + Seek {}
impl<T: Blocks + Seek> Both for T {}

impl Input {
    /// What can be read once.
    pub fn pipe(input: impl Read + 'static) -> Input {
        Input {
            kind: Kind::Pipe(Box::new(Plain(input))),
        }
    }

    /// What can be read from any place. It begins at 0.
    pub fn file(input: impl Read + Seek + 'static) -> Input {
        Input::blocks(Plain(input))
    }

    /// The same, in blocks.
    pub fn blocks(input: impl Blocks + Seek + 'static) -> Input {
        Input {
            kind: Kind::File(Box::new(input)),
        }
    }

    /// Both ways to read it, where there are two. They move each other.
    pub(super) fn open(self) -> (Tape, Option<Disk>) {
        match self.kind {
            Kind::Pipe(input) => (Tape::new(input), None),
            Kind::File(input) => {
                let disk = Disk(Rc::new(RefCell::new(input)));
                (Tape::new(Box::new(disk.clone())), Some(disk))
            }
        }
    }
}

impl std::fmt::Debug for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.kind {
            Kind::Pipe(_) => "Input::pipe",
            Kind::File(_) => "Input::file",
        })
    }
}

/// A file with several readers, of which one is used at a time.
#[derive(Clone)]
pub(super) struct Disk(Rc<RefCell<Box<dyn Both>>>);

impl Read for Disk {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.borrow_mut().read(buffer)
    }
}

impl Blocks for Disk {
    fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        self.0.borrow_mut().exchange(block)
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.borrow_mut().seek(to)
    }
}

/// Keeps what is read, until it is let go or too much. Its clones share one place.
#[derive(Clone)]
pub(super) struct Tape(Rc<RefCell<Kept>>);

struct Kept {
    input: Box<dyn Blocks>,
    bytes: Vec<u8>,
    at: usize,
    /// What is read is added to `bytes`.
    keeps: bool,
    /// Ends where `bytes` do.
    ends: bool,
    /// Something was read that is not in `bytes`.
    lost: bool,
}

/// Most that is kept.
const KEPT: usize = 4 << 20;
/// Most that is kept unasked: a longer header is of so many signals that nobody looks at what each of them does.
const KEPT_HEADER: usize = 1 << 20;

impl Tape {
    fn new(input: Box<dyn Blocks>) -> Tape {
        Tape(Rc::new(RefCell::new(Kept {
            input,
            bytes: Vec::new(),
            at: 0,
            keeps: true,
            ends: false,
            lost: false,
        })))
    }

    /// The first bytes, so many or all, as far as `enough` wants them.
    pub(super) fn head(&self, most: usize, enough: impl Fn(&[u8]) -> bool) -> io::Result<Vec<u8>> {
        let kept = &mut *self.0.borrow_mut();
        while kept.bytes.len() < most && !enough(&kept.bytes) {
            if kept.more(most - kept.bytes.len())? == 0 {
                break;
            }
        }
        Ok(kept.bytes[..kept.bytes.len().min(most)].to_vec())
    }

    /// Reads as much as can be kept, and ends behind that until it is let go.
    pub(super) fn keep(&self) -> io::Result<()> {
        let kept = &mut *self.0.borrow_mut();
        while kept.bytes.len() < KEPT && kept.more(KEPT - kept.bytes.len())? > 0 {}
        kept.ends = true;
        Ok(())
    }

    /// Back to the beginning. False where that is gone.
    pub(super) fn rewind(&self) -> bool {
        let mut kept = self.0.borrow_mut();
        kept.at = 0;
        !kept.lost
    }

    /// What comes next is read once.
    pub(super) fn let_go(&self) {
        let mut kept = self.0.borrow_mut();
        (kept.keeps, kept.ends) = (false, false);
    }
}

impl Kept {
    /// Whether the input itself comes next, and nothing is kept any more.
    fn is_past(&mut self) -> bool {
        let past = self.at == self.bytes.len()
            && !self.ends
            && (!self.keeps || self.bytes.len() >= KEPT_HEADER);
        if past {
            (self.bytes, self.at) = (Vec::new(), 0);
            (self.keeps, self.lost) = (false, true);
        }
        past
    }

    /// Reads on and keeps it.
    fn more(&mut self, most: usize) -> io::Result<usize> {
        let from = self.bytes.len();
        self.bytes.resize(from + most.min(BLOCK), 0);
        let read = loop {
            match self.input.read(&mut self.bytes[from..]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                read => break read,
            }
        };
        self.bytes.truncate(from + *read.as_ref().unwrap_or(&0));
        read
    }
}

const BLOCK: usize = 64 << 10;

impl Blocks for Tape {
    fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        {
            let kept = &mut *self.0.borrow_mut();
            if kept.is_past() {
                return kept.input.exchange(block);
            }
        }
        self.read(block)
    }
}

impl Read for Tape {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let kept = &mut *self.0.borrow_mut();
        if kept.is_past() {
            return kept.input.read(buffer);
        }
        if kept.at == kept.bytes.len() {
            if kept.ends {
                return Ok(0);
            }
            if kept.more(buffer.len().min(KEPT_HEADER - kept.bytes.len()))? == 0 {
                return Ok(0);
            }
        }
        let mut rest = &kept.bytes[kept.at..];
        let n = rest.read(buffer)?;
        kept.at += n;
        Ok(n)
    }
}
