//! Suggestions for mistyped names.

/// Returns the entry of `names` that is closest to `given`, or `None` when no entry is close
/// enough to be a typing error.
///
/// ```
/// use program::nearest::nearest;
///
/// assert_eq!(nearest("camara", ["imu", "camera"]), Some("camera"));
/// assert_eq!(nearest("lidar", ["imu", "camera"]), None);
/// ```
pub fn nearest<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = given.to_lowercase();
    let edits = |name: &str| strsim::damerau_levenshtein(&given, &name.to_lowercase());
    names
        .into_iter()
        .map(|name| (edits(name), name))
        .filter(|(edits, name)| *edits <= allowed_edits(given.len().max(name.len())))
        .min()
        .map(|(_edits, name)| name)
}

/// Returns the text between an unknown name and the list of known ones in an error message:
/// `"; did you mean camera?"`, or `";"` when no name is close.
pub fn hint<'a>(given: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(given, names).map_or_else(|| ";".into(), |name| format!("; did you mean {name}?"))
}

/// One edit in a short word; one for every three letters in a longer word.
fn allowed_edits(letters: usize) -> usize {
    match letters {
        0..=1 => 0,
        2..=5 => 1,
        longer => longer / 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_swapped_or_extra_letter_is_a_typing_error() {
        for given in ["toipcs", "topic", "topicss", "Topics"] {
            assert_eq!(nearest(given, ["topics", "info", "echo"]), Some("topics"));
        }
    }

    #[test]
    fn another_word_is_not_a_typing_error() {
        for given in ["", "x", "hertz", "list"] {
            assert_eq!(nearest(given, ["topics", "info", "hz", "bw"]), None);
        }
    }

    #[test]
    fn the_closest_of_several_names_is_suggested() {
        assert_eq!(
            nearest("tag-left", ["tags-left", "tag-front", "tags"]),
            Some("tags-left")
        );
        assert_eq!(hint("ech", ["echo"]), "; did you mean echo?");
        assert_eq!(hint("ech", ["imu"]), ";");
    }
}
