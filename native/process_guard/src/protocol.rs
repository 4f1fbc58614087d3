//! The guard's two protocols: plain lines for people, frames for a supervisor. Pure.
//!
//! A frame is its length in two bytes, big-endian, then a letter for its kind, then its content:
//!
//! | frame | from | meaning |
//! |---|---|---|
//! | `l` text | guard | a line that the program printed |
//! | `o` number | guard | the number of lines omitted here, in decimal digits |
//! | `h` | guard | a signal stopped the program for too long; the guard kills it |
//! | `e` | guard | the end of the output; no guarded process is left |
//! | `c` number | supervisor | the number of `l` and `o` frames that it has taken, in two bytes |
//! | `s` | supervisor | a request to end the program |
//! | `e` | supervisor | acknowledges the guard's `e`; the guard may exit |

use crate::limiter::Item;
use crate::splitter;

const HALTED: &[u8] = b"process_guard: program stopped by a signal for too long\n";

/// How the guard writes its output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Protocol {
    Lines,
    /// At most `window` frames `l` and `o` may be on their way to the supervisor.
    Frames {
        window: u32,
    },
}

impl Protocol {
    /// Returns how many items the guard may send at first.
    pub fn initial_credits(self) -> u32 {
        match self {
            Protocol::Lines => u32::MAX,
            Protocol::Frames { window } => window,
        }
    }

    pub fn encode(self, item: &Item) -> Vec<u8> {
        match (self, item) {
            (Protocol::Lines, Item::Line(line)) => [line, b"\n".as_slice()].concat(),
            (Protocol::Lines, Item::Omitted(count)) => {
                format!("process_guard: {count} lines omitted\n").into_bytes()
            }
            (Protocol::Frames { .. }, Item::Line(line)) => frame(b'l', &splitter::text(line)),
            (Protocol::Frames { .. }, Item::Omitted(count)) => frame(b'o', &count.to_string()),
        }
    }
    /// Encodes the end of the output.
    pub fn end(self) -> Vec<u8> {
        match self {
            Protocol::Lines => Vec::new(),
            Protocol::Frames { .. } => frame(b'e', ""),
        }
    }

    /// Encodes the notice that a signal stopped the program for too long.
    pub fn halted(self) -> Vec<u8> {
        match self {
            Protocol::Lines => HALTED.to_vec(),
            Protocol::Frames { .. } => frame(b'h', ""),
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

/// Reads the supervisor's frames from standard input.
#[derive(Debug, Default)]
pub struct RequestReader {
    unread: Vec<u8>,
}

/// The sum of the frames in the bytes read.
#[derive(Debug, PartialEq)]
pub struct Request {
    pub credits: u32,
    pub stop: bool,
    pub acknowledged: bool,
}

impl RequestReader {
    /// Accepts bytes that were read. With plain lines, any byte is a request to stop.
    pub fn read(&mut self, protocol: Protocol, bytes: &[u8]) -> Request {
        let plain = protocol == Protocol::Lines;
        let mut request = Request {
            credits: 0,
            stop: plain && !bytes.is_empty(),
            acknowledged: false,
        };
        if !plain {
            self.unread.extend_from_slice(bytes);
            while let Some(frame) = self.next_frame() {
                match frame[..] {
                    [b'c', high, low] => {
                        request.credits += u32::from(u16::from_be_bytes([high, low]));
                    }
                    [b'e'] => request.acknowledged = true,
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

    const FRAMES: Protocol = Protocol::Frames { window: 2 };

    #[test]
    fn a_frame_starts_with_its_length() {
        let line = Item::Line(b"ab\xFF".to_vec());
        assert_eq!(FRAMES.encode(&line), b"\0\x04lab?");
        assert_eq!(FRAMES.encode(&Item::Omitted(12)), b"\0\x03o12");
        assert_eq!(FRAMES.halted(), b"\0\x01h");
        assert_eq!(Protocol::Lines.encode(&line), b"ab\xFF\n");
    }

    #[test]
    fn requests_are_read_wherever_the_reads_are_cut() {
        let bytes = b"\0\x03c\0\x02\0\x03c\x01\0\0\x01s\0\x01e";
        let expected = Request {
            credits: 258,
            stop: true,
            acknowledged: true,
        };
        assert_eq!(RequestReader::default().read(FRAMES, bytes), expected);
        let mut requests = RequestReader::default();
        let mut sum = requests.read(FRAMES, b"");
        for byte in bytes {
            let request = requests.read(FRAMES, &[*byte]);
            sum.credits += request.credits;
            sum.stop |= request.stop;
            sum.acknowledged |= request.acknowledged;
        }
        assert_eq!(sum, expected);
    }

    #[test]
    fn with_plain_lines_any_byte_is_a_request_to_stop() {
        let request = RequestReader::default().read(Protocol::Lines, b"\n");
        assert!(request.stop && request.credits == 0 && !request.acknowledged);
    }
}
