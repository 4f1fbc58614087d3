//! Formats a tree of JSON values as indented text, in the style of YAML.

use serde_json::Value;
use std::fmt::Write;

/// Formats the fields of an object, one per line, indented by `depth` steps. Each line ends with
/// a newline.
pub fn fields(value: &Value, depth: usize) -> String {
    let mut text = String::new();
    object(&mut text, value, depth);
    text
}

fn object(text: &mut String, value: &Value, depth: usize) {
    for (name, value) in value.as_object().into_iter().flatten() {
        let _ = write!(text, "{:1$}{name}:", "", 2 * depth);
        field(text, value, depth);
    }
}

fn field(text: &mut String, value: &Value, depth: usize) {
    match value {
        Value::Object(_) => {
            text.push('\n');
            object(text, value, depth + 1);
        }
        Value::Array(items) if items.iter().any(Value::is_object) => {
            text.push('\n');
            items
                .iter()
                .for_each(|item| list_item(text, item, depth + 1));
        }
        _ => {
            let _ = writeln!(text, " {}", inline(value));
        }
    }
}

/// Formats an object in a list. Its first line starts with a dash.
fn list_item(text: &mut String, item: &Value, depth: usize) {
    let lines = fields(item, depth + 1);
    let dash = 2 * depth;
    text.push_str(&lines[..dash]);
    text.push('-');
    text.push_str(&lines[dash + 1..]);
}

fn inline(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(inline).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Null => "unknown".into(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn objects_are_indented_and_lists_of_numbers_are_on_one_line() {
        let value = json!({
            "frame_id": "imu",
            "speed": null,
            "stamp": {"sec": 1, "nanosec": 2},
            "velocity": [0.5, -1.0],
            "tags": [{"id": 3, "corners": [[1, 2], [3, 4]]}, {"id": 4}],
            "none": []
        });
        let expected = "  frame_id: imu
  speed: unknown
  stamp:
    sec: 1
    nanosec: 2
  velocity: [0.5, -1.0]
  tags:
    - id: 3
      corners: [[1, 2], [3, 4]]
    - id: 4
  none: []
";
        assert_eq!(fields(&value, 1), expected);
    }
}
