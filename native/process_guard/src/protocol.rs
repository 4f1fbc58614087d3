//! The two ways in which the guard speaks: plain lines for people, frames for a supervisor. Pure.
//!
//! A frame is its length in two bytes, the higher first, then a letter that says what it is, then
//! the rest:
//!
//! | frame | from | |
//! |---|---|---|
//! | `l` text | guard | a line that the program printed |
//! | `o` number | guard | so many lines were left out here; the number in decimal digits |
//! | `h` | guard | the program was halted by a signal for too long, and is ended |
//! | `e` | guard | that was all; nothing of the program is left |
//! | `c` number | supervisor | it has taken so many of the frames `l` and `o`; the number in two bytes |
//! | `s` | supervisor | end the program |
//! | `e` | supervisor | it has read to the guard's `e`, and says nothing more: the guard may go |

use crate::limiter::Item;
use crate::lines;

/// How the guard speaks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speech {
    Plain,
    /// The supervisor wants at most so many frames `l` and `o` that it has not taken yet.
    Frames {
        window: u32,
    },
}

impl Speech {
    /// How many items may go out at first.
    pub fn credits(self) -> u32 {
        match self {
            Speech::Plain => u32::MAX,
            Speech::Frames { window } => window,
        }
    }

    pub fn item(self, item: &Item) -> Vec<u8> {
        match (self, item) {
            (Speech::Plain, Item::Line(line)) => [line, b"\n".as_slice()].concat(),
            (Speech::Plain, Item::LeftOut(count)) => {
                format!("process_guard: {count} lines were left out\n").into_bytes()
            }
            (Speech::Frames { .. }, Item::Line(line)) => frame(b'l', &lines::text(line)),
            (Speech::Frames { .. }, Item::LeftOut(count)) => frame(b'o', &count.to_string()),
        }
    }

    /// What comes last.
    pub fn end(self) -> Vec<u8> {
        match self {
            Speech::Plain => Vec::new(),
            Speech::Frames { .. } => frame(b'e', ""),
        }
    }

    pub fn halted(self) -> Vec<u8> {
        match self {
            Speech::Plain => b"process_guard: the program was halted for too long\n".to_vec(),
            Speech::Frames { .. } => frame(b'h', ""),
        }
    }
}

fn frame(letter: u8, rest: &str) -> Vec<u8> {
    let length = u16::try_from(1 + rest.len()).unwrap_or(u16::MAX);
    let mut frame = length.to_be_bytes().to_vec();
    frame.push(letter);
    frame.extend_from_slice(&rest.as_bytes()[..usize::from(length) - 1]);
    frame
}

/// What a supervisor says, read from standard input.
#[derive(Debug, Default)]
pub struct Requests {
    unread: Vec<u8>,
}

/// What came of the bytes read.
#[derive(Debug, PartialEq)]
pub struct Request {
    pub credits: u32,
    pub stop: bool,
    pub parted: bool,
}

impl Requests {
    /// Takes what was read. To the plain guard any byte is the request to stop.
    pub fn read(&mut self, speech: Speech, bytes: &[u8]) -> Request {
        let plain = speech == Speech::Plain;
        let mut request = Request {
            credits: 0,
            stop: plain && !bytes.is_empty(),
            parted: false,
        };
        if !plain {
            self.unread.extend_from_slice(bytes);
            while let Some(frame) = self.next_frame() {
                match frame[..] {
                    [b'c', high, low] => {
                        request.credits += u32::from(u16::from_be_bytes([high, low]));
                    }
                    [b'e'] => request.parted = true,
                    _ => request.stop = true,
                }
            }
        }
        request
    }

    fn next_frame(&mut self) -> Option<Vec<u8>> {
        let (length, rest) = self.unread.split_first_chunk::<2>()?;
        let frame = rest
            .get(..usize::from(u16::from_be_bytes(*length)))?
            .to_vec();
        self.unread.drain(..2 + frame.len());
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: Speech = Speech::Frames { window: 2 };

    #[test]
    fn a_line_is_a_frame_with_its_length() {
        let line = Item::Line(b"ab\xFF".to_vec());
        assert_eq!(FRAMES.item(&line), b"\0\x04lab?");
        assert_eq!(FRAMES.item(&Item::LeftOut(12)), b"\0\x03o12");
        assert_eq!(FRAMES.halted(), b"\0\x01h");
        assert_eq!(Speech::Plain.item(&line), b"ab\xFF\n");
    }

    #[test]
    fn requests_are_understood_however_their_bytes_come() {
        let said = b"\0\x03c\0\x02\0\x03c\x01\0\0\x01s\0\x01e";
        let expected = Request {
            credits: 258,
            stop: true,
            parted: true,
        };
        assert_eq!(Requests::default().read(FRAMES, said), expected);
        let mut requests = Requests::default();
        let mut sum = requests.read(FRAMES, b"");
        for byte in said {
            let request = requests.read(FRAMES, &[*byte]);
            sum.credits += request.credits;
            sum.stop |= request.stop;
            sum.parted |= request.parted;
        }
        assert_eq!(sum, expected);
    }

    #[test]
    fn to_the_plain_guard_any_byte_is_the_request_to_stop() {
        let request = Requests::default().read(Speech::Plain, b"\n");
        assert!(request.stop && request.credits == 0 && !request.parted);
    }
}
