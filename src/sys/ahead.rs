//! Reads a file ahead of whoever uses it, on another processor.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// Read at once. Three of them go round: one is used, one waits, one is being read.
const BLOCK: usize = 256 << 10;
const BLOCKS: usize = 3;

type Block = (Vec<u8>, io::Result<usize>);

/// A file from some place on.
pub(super) struct Ahead {
    read: Receiver<Block>,
    used: Sender<Vec<u8>>,
    block: Vec<u8>,
    /// Where the block is used, and where it ends.
    at: usize,
    end: usize,
}

impl Ahead {
    /// From this byte on, wherever the file's own place is. It ends with the first error, or at the end of the file.
    pub(super) fn start(file: File, from: u64) -> io::Result<Ahead> {
        let (used, spare) = channel::<Vec<u8>>();
        let (give, read) = channel();
        for _ in 0..BLOCKS {
            // The other end is here.
            let _ = used.send(vec![0; BLOCK]);
        }
        thread::Builder::new()
            .name("reader".into())
            .spawn(move || read_on(&file, from, &spare, &give))?;
        Ok(Ahead {
            read,
            used,
            block: Vec::new(),
            at: 0,
            end: 0,
        })
    }
}

impl Ahead {
    /// Reads on, as [`Read::read`] does, and gives a whole block for the one it is given where that can be.
    pub(super) fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        if self.at < self.end {
            return self.read(block);
        }
        let Ok((next, read)) = self.read.recv() else {
            return Ok(0);
        };
        let used = std::mem::replace(block, next);
        self.give_back(used);
        let own = std::mem::take(&mut self.block);
        (self.at, self.end) = (0, 0);
        self.give_back(own);
        read
    }

    /// To be read into once more.
    fn give_back(&self, mut used: Vec<u8>) {
        if !used.is_empty() {
            used.resize(BLOCK, 0);
            // The other thread may have ended.
            let _ = self.used.send(used);
        }
    }
}

/// Until nobody wants more.
fn read_on(file: &File, mut from: u64, spare: &Receiver<Vec<u8>>, give: &Sender<Block>) {
    while let Ok(mut block) = spare.recv() {
        let read = loop {
            match file.read_at(&mut block, from) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                read => break read,
            }
        };
        let n = *read.as_ref().unwrap_or(&0);
        from += n as u64;
        if give.send((block, read)).is_err() || n == 0 {
            break;
        }
    }
}

impl Read for Ahead {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.end {
            // What has ended once has ended.
            let Ok((block, read)) = self.read.recv() else {
                return Ok(0);
            };
            let used = std::mem::replace(&mut self.block, block);
            self.give_back(used);
            (self.at, self.end) = (0, read?);
        }
        let n = (&self.block[self.at..self.end]).read(buffer)?;
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn file(bytes: &[u8], name: &str) -> File {
        let path = std::env::temp_dir().join(format!("biss-{name}-{}", std::process::id()));
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .unwrap();
        std::fs::remove_file(&path).unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    #[test]
    fn every_byte_comes_once_and_in_its_place() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for size in [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK + 77] {
            let bytes: Vec<u8> = (0..size).map(|_| rng.u8(..)).collect();
            let from = rng.usize(..=size);
            let mut ahead = Ahead::start(file(&bytes, "ahead"), from as u64).unwrap();
            let mut found = Vec::new();
            let mut block = vec![0; 1 << 17];
            loop {
                let room = rng.usize(1..block.len());
                let read = if rng.bool() {
                    ahead.exchange(&mut block)
                } else {
                    ahead.read(&mut block[..room])
                };
                match read.unwrap() {
                    0 => break,
                    n => found.extend_from_slice(&block[..n]),
                }
            }
            assert!(found == bytes[from..], "{size} from {from}");
            assert_eq!(ahead.read(&mut block).unwrap(), 0);
        }
    }

    #[test]
    fn errors_come_after_what_is_good_and_leaving_early_leaves_nobody_behind() {
        // A folder opens, and cannot be read.
        let folder = File::open(std::env::temp_dir()).unwrap();
        let mut ahead = Ahead::start(folder, 0).unwrap();
        assert!(ahead.read(&mut [0; 8]).is_err());
        assert_eq!(ahead.read(&mut [0; 8]).unwrap(), 0);
        let mut ahead = Ahead::start(file(&[7; 9 * BLOCK], "early"), 0).unwrap();
        let mut one = [0; 8];
        assert_eq!((ahead.read(&mut one).unwrap(), one), (8, [7; 8]));
    }
}
