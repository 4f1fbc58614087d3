//! Formatting of quantities for people.

/// Formats a time span in a suitable unit.
pub fn span(seconds: f64) -> String {
    match seconds.abs() {
        s if s < 1e-3 => format!("{:.1} µs", seconds * 1e6),
        s if s < 1.0 => format!("{:.1} ms", seconds * 1e3),
        s if s < 600.0 => format!("{seconds:.1} s"),
        s if s < 36_000.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.0} h", seconds / 3600.0),
    }
}

/// Formats a number of bytes in a suitable unit.
pub fn bytes(count: f64) -> String {
    match count {
        c if c < 1e3 => format!("{count:.0} B"),
        c if c < 1e6 => format!("{:.1} kB", count / 1e3),
        c if c < 1e9 => format!("{:.2} MB", count / 1e6),
        _ => format!("{:.2} GB", count / 1e9),
    }
}

/// Formats a rate.
pub fn rate(hertz: f64) -> String {
    match hertz {
        h if h < 10.0 => format!("{hertz:.2} Hz"),
        h if h < 1000.0 => format!("{hertz:.1} Hz"),
        _ => format!("{hertz:.0} Hz"),
    }
}

/// Converts nanoseconds to seconds.
pub fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// Returns the seconds since a time of the ring's clock.
pub fn age_s(now_ns: u64, then_ns: u64) -> f64 {
    seconds(now_ns.saturating_sub(then_ns))
}

/// Rounds a number, so that a line of JSON stays readable.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_have_a_suitable_unit() {
        assert_eq!(span(0.000_012_34), "12.3 µs");
        assert_eq!(span(0.0334), "33.4 ms");
        assert_eq!(span(59.94), "59.9 s");
        assert_eq!(span(7200.0), "120 min");
        assert_eq!(bytes(324.0), "324 B");
        assert_eq!(bytes(9_217_320.0), "9.22 MB");
        assert_eq!(rate(29.97), "30.0 Hz");
        assert_eq!(rate(0.5), "0.50 Hz");
        assert_eq!(age_s(5, 9), 0.0);
        assert_eq!(rounded(1.23456, 2), 1.23);
    }
}
