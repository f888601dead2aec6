//! The part of JSON Schema that this project writes; a word beyond it is a finding, so that nothing passes unseen.

use serde_json::Value;

/// Words that are looked at, and those that only explain.
const WORDS: [&str; 14] = [
    "type",
    "const",
    "enum",
    "required",
    "properties",
    "additionalProperties",
    "items",
    "minItems",
    "maxItems",
    "minimum",
    "maximum",
    "title",
    "description",
    "$schema",
];

/// Appends what does not fit, with its place.
pub fn misfits(value: &Value, schema: &Value, at: &str, found: &mut Vec<String>) {
    for word in schema.as_object().into_iter().flat_map(|map| map.keys()) {
        if !WORDS.contains(&word.as_str()) {
            found.push(format!("{at}: the schema says \"{word}\", which is not looked at here"));
        }
    }
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(n) if n.is_i64() || n.is_u64() => "integer",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let fits = |wanted: &Value| wanted == kind || (wanted == "number" && kind == "integer");
    let is_allowed = match &schema["type"] {
        Value::Null => true,
        Value::Array(list) => list.iter().any(fits),
        one => fits(one),
    };
    if !is_allowed {
        found.push(format!("{at}: {kind} is not {}", schema["type"]));
    }
    if schema.get("const").is_some_and(|wanted| wanted != value) {
        found.push(format!("{at}: {value} is not {}", schema["const"]));
    }
    if schema["enum"].as_array().is_some_and(|list| !list.contains(value)) {
        found.push(format!("{at}: {value} is none of {}", schema["enum"]));
    }
    let is_below = |word: &str, n: f64| schema[word].as_f64().is_some_and(|bound| n < bound);
    let is_above = |word: &str, n: f64| schema[word].as_f64().is_some_and(|bound| n > bound);
    if value.as_f64().is_some_and(|n| is_below("minimum", n) || is_above("maximum", n)) {
        found.push(format!("{at}: {value} is out of range"));
    }
    let length = value.as_array().map(|list| list.len() as f64);
    if length.is_some_and(|n| is_below("minItems", n) || is_above("maxItems", n)) {
        found.push(format!("{at}: has {length:?} items"));
    }
    inner_misfits(value, schema, at, found);
}

fn inner_misfits(value: &Value, schema: &Value, at: &str, found: &mut Vec<String>) {
    for name in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if value.is_object() && value.get(name).is_none() {
            found.push(format!("{at}: {name} is missing"));
        }
    }
    for (name, inner) in value.as_object().into_iter().flatten() {
        let own = schema["properties"].get(name).or_else(|| schema.get("additionalProperties"));
        if let Some(own) = own {
            misfits(inner, own, &format!("{at}.{name}"), found);
        }
    }
    for (index, inner) in value.as_array().into_iter().flatten().enumerate() {
        misfits(inner, &schema["items"], &format!("{at}[{index}]"), found);
    }
}
