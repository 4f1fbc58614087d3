//! What somebody may have meant who mistyped a name.

/// The one of `names` that is nearest to what was given, if it is near enough to be a slip.
///
/// ```
/// use program::nearest::nearest;
///
/// assert_eq!(nearest("camara", ["imu", "camera"]), Some("camera"));
/// assert_eq!(nearest("lidar", ["imu", "camera"]), None);
/// ```
pub fn nearest<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = given.to_lowercase();
    let slips = |name: &str| strsim::damerau_levenshtein(&given, &name.to_lowercase());
    names
        .into_iter()
        .map(|name| (slips(name), name))
        .filter(|(slips, name)| *slips <= allowed(given.len().max(name.len())))
        .min()
        .map(|(_slips, name)| name)
}

/// What stands in a sentence between the name that nobody has and those that there are:
/// `"; did you mean camera?"`, or `";"` where no name is near.
pub fn hint<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(given, names).map_or_else(|| ";".into(), |name| format!("; did you mean {name}?"))
}

/// One slip in a short word, one more for each three letters.
fn allowed(letters: usize) -> usize {
    match letters {
        0..=1 => 0,
        2..=5 => 1,
        more => more / 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_that_are_missing_swapped_or_too_many_are_slips() {
        for given in ["toipcs", "topic", "topicss", "Topics"] {
            assert_eq!(nearest(given, ["topics", "info", "echo"]), Some("topics"));
        }
    }

    #[test]
    fn another_word_is_no_slip() {
        for given in ["", "x", "hertz", "list"] {
            assert_eq!(nearest(given, ["topics", "info", "hz", "bw"]), None);
        }
    }

    #[test]
    fn of_several_the_nearest_is_meant() {
        assert_eq!(
            nearest("tag-left", ["tags-left", "tag-front", "tags"]),
            Some("tags-left")
        );
        assert_eq!(hint("ech", ["echo"]), "; did you mean echo?");
        assert_eq!(hint("ech", ["imu"]), ";");
    }
}
