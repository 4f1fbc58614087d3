//! Splits a program's output into lines of bounded length. Pure.

/// The most bytes of a line. A longer line is split.
pub const LONGEST: usize = 4096;

/// Splits a byte stream into lines. `\n`, `\r` and `\r\n` end a line, so that each state of a
/// progress bar is a line of its own.
#[derive(Default)]
pub struct LineSplitter {
    line: Vec<u8>,
    after_return: bool,
}

impl LineSplitter {
    /// Accepts the next bytes and passes each line that they complete to `take`.
    pub fn split(&mut self, mut bytes: &[u8], mut take: impl FnMut(Vec<u8>)) {
        while let Some(&first) = bytes.first() {
            if self.after_return && first == b'\n' {
                self.after_return = false;
                bytes = &bytes[1..];
                continue;
            }
            let end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let (text, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
            self.append(text, &mut take);
            bytes = rest;
            if end.is_some() {
                self.end_line(bytes[0], &mut take);
                bytes = &bytes[1..];
            }
        }
    }

    /// Returns the last line if no line end followed it.
    pub fn finish(&mut self) -> Option<Vec<u8>> {
        let line = std::mem::take(&mut self.line);
        (!line.is_empty()).then_some(line)
    }

    fn append(&mut self, mut text: &[u8], take: &mut impl FnMut(Vec<u8>)) {
        self.after_return &= text.is_empty();
        while self.line.len() + text.len() > LONGEST {
            let (fits, rest) = text.split_at(LONGEST - self.line.len());
            self.line.extend_from_slice(fits);
            let begun = self.line.split_off(whole_characters(&self.line));
            take(std::mem::replace(&mut self.line, begun));
            text = rest;
        }
        self.line.extend_from_slice(text);
    }

    // A progress bar may begin with its carriage return, which then ends no line.
    fn end_line(&mut self, end: u8, take: &mut impl FnMut(Vec<u8>)) {
        if end == b'\n' || !self.line.is_empty() {
            self.after_return = end == b'\r';
            take(std::mem::take(&mut self.line));
        }
    }
}

/// Returns how many bytes of `line` are whole UTF-8 characters; all of them if `line` is not
/// text.
fn whole_characters(line: &[u8]) -> usize {
    for back in 1..=line.len().min(3) {
        let byte = line[line.len() - back];
        if byte & 0xC0 != 0x80 {
            let needed = byte.leading_ones() as usize;
            let begun = (2..=4).contains(&needed) && needed > back;
            return line.len() - if begun { back } else { 0 };
        }
    }
    line.len()
}

/// Decodes `line` with `?` for each invalid sequence. The result is never longer than `line`.
pub fn text(line: &[u8]) -> String {
    let mut text = String::with_capacity(line.len());
    for chunk in line.utf8_chunks() {
        text.push_str(chunk.valid());
        if !chunk.invalid().is_empty() {
            text.push('?');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(parts: &[&[u8]]) -> Vec<Vec<u8>> {
        let mut splitter = LineSplitter::default();
        let mut lines = Vec::new();
        for part in parts {
            splitter.split(part, |line| lines.push(line));
        }
        lines.extend(splitter.finish());
        lines
    }

    fn split_text(parts: &[&str]) -> Vec<String> {
        let bytes: Vec<&[u8]> = parts.iter().map(|part| part.as_bytes()).collect();
        split(&bytes).iter().map(|line| text(line)).collect()
    }

    #[test]
    fn each_line_end_counts_once_wherever_the_reads_are_cut() {
        let expected = ["a", "", "b", "c", "", "d"];
        let printed = "a\n\nb\rc\r\n\r\nd";
        assert_eq!(split_text(&[printed]), expected);
        let bytes: Vec<&[u8]> = printed.as_bytes().chunks(1).collect();
        let lines = split(&bytes);
        assert_eq!(
            lines.iter().map(|line| text(line)).collect::<Vec<_>>(),
            expected
        );
    }

    #[test]
    fn each_state_of_a_progress_bar_is_a_line() {
        assert_eq!(
            split_text(&["\r1 %\r2 %", "\r3 %\n"]),
            ["1 %", "2 %", "3 %"]
        );
        assert_eq!(split_text(&["1 %\r", "2 %\r", "\n"]), ["1 %", "2 %"]);
    }

    #[test]
    fn a_line_of_the_maximum_length_stays_whole_and_a_longer_one_is_split() {
        let whole = vec![b'x'; LONGEST];
        assert!(split(&[&whole, b"\n"]) == vec![whole.clone()]);
        assert!(split(&[&whole, b"y\n"]) == vec![whole, vec![b'y']]);
        let long = vec![b'x'; 3 * LONGEST + 7];
        let lengths: Vec<usize> = split(&[&long]).iter().map(Vec::len).collect();
        assert_eq!(lengths, [LONGEST, LONGEST, LONGEST, 7]);
    }

    #[test]
    fn no_character_is_split() {
        for character in ["ä", "€", "🤖"] {
            for before in 0..5 {
                let printed = "x".repeat(before) + &character.repeat(LONGEST);
                for part in [1, 1000, printed.len()] {
                    let parts: Vec<&[u8]> = printed.as_bytes().chunks(part).collect();
                    let lines = split(&parts);
                    assert!(lines.iter().all(|line| line.len() <= LONGEST));
                    assert!(lines.iter().all(|line| str::from_utf8(line).is_ok()));
                    assert_eq!(lines.concat(), printed.as_bytes());
                }
            }
        }
    }

    #[test]
    fn bytes_that_are_not_text_are_split_and_never_grow() {
        for byte in [0x80, 0xC3, 0xE2, 0xF0, 0xFF] {
            let lines = split(&[&vec![byte; 3 * LONGEST]]);
            assert_eq!(lines.concat().len(), 3 * LONGEST);
            assert!(lines.iter().all(|line| text(line).len() <= LONGEST));
        }
        assert_eq!(text(b"a\xFFb\xE2\x82"), "a?b?");
    }
}
