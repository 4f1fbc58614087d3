//! CRC-32 (IEEE 802.3), bit by bit: it runs over 24 bytes when a segment is opened.

pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| shift(crc))
    })
}

fn shift(crc: u32) -> u32 {
    (crc >> 1) ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn the_check_value_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
    }
}
