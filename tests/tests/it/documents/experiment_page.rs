//! The reference of experiment files, made from their JSON Schema.

use serde_json::Value;

/// Sections in the order in which people write them: the path of a section, and where its schema is.
const SECTIONS: [(&str, &str); 17] = [
    ("", ""),
    ("dataset", "dataset"),
    ("dataset.splits", "split_table"),
    ("dataset.splits.seeded", "seeded"),
    ("dataset.synthetic", "synthetic"),
    ("preprocess", "preprocess"),
    ("descriptor", "descriptor"),
    ("descriptor.genes", "genes"),
    ("search", "search"),
    ("search.fitness", "fitness"),
    ("ga", "ga"),
    ("stop", "stop"),
    ("coordinator", "coordinator"),
    ("recognition", "recognition"),
    ("results", "results"),
    ("sweep", "sweep"),
    ("sweep.variants.NAME", "variant"),
];

const INTRODUCTION: &str = "# Experiment files

Made from the output of `coordinator schema`, which your editor can check files against; a test keeps it so.

An experiment is a TOML file. Required are `version = 1` and `dataset.root`; what is left out has its default. An unknown key is an error. [`experiments/paper.toml`](../../../experiments/paper.toml) has every key of the paper's search with a comment.
";

/// The page.
pub fn markdown(schema: &Value) -> String {
    let definitions = schema["$defs"].as_object().unwrap();
    let mut page = INTRODUCTION.to_owned();
    for (path, name) in SECTIONS {
        let section = if name.is_empty() { schema } else { &definitions[name] };
        let heading = if path.is_empty() { "Top level".to_owned() } else { format!("`[{path}]`") };
        page += &format!("\n## {heading}\n\n{}\n\n", sentence(&section["description"]));
        page += "| key | values | default | meaning |\n|---|---|---|---|\n";
        for (key, property) in section["properties"].as_object().unwrap() {
            let cells = [values(property, schema), default(property), meaning(property, schema)];
            page += &format!("| `{key}` | {} |\n", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
        }
    }
    // A section that nobody has listed would be missing without a word.
    let tables = definitions.iter().filter(|(_, definition)| definition["properties"].is_object());
    for (name, _) in tables.filter(|(name, _)| *name != "interval") {
        assert!(SECTIONS.iter().any(|(_, section)| section == name), "{name}: a section of no page");
    }
    page
}

fn sentence(text: &Value) -> String {
    let text = text.as_str().unwrap_or_default().replace('\n', " ").replace("  ", " ");
    // Placeholders are no HTML.
    text.replace('<', "&lt;").replace('>', "&gt;").replace("\\[", "[").replace("\\]", "]")
}

fn resolved<'a>(schema: &'a Value, root: &'a Value) -> &'a Value {
    let name = schema["$ref"].as_str().and_then(|name| name.strip_prefix("#/$defs/"));
    name.map_or(schema, |name| &root["$defs"][name])
}

/// What a key may be, in a few words.
fn values(schema: &Value, root: &Value) -> String {
    let schema = resolved(schema, root);
    if let Some(word) = schema.get("const") {
        return format!("`{word}`");
    }
    if let Some(words) = schema["enum"].as_array() {
        return words.iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", ");
    }
    for choice in ["oneOf", "anyOf"] {
        if let Some(choices) = schema[choice].as_array() {
            let parts: Vec<String> = choices.iter().map(|choice| values(choice, root)).collect();
            return parts.join(" or ").replace("` or `", "`, `");
        }
    }
    let bound =
        |key: &str| schema.get(key).filter(|bound| bound.as_f64().is_some_and(|bound| bound.abs() < 1e15));
    let range = match (bound("minimum").or(bound("exclusiveMinimum")), bound("maximum")) {
        (Some(low), Some(high)) if low == high => format!(": {low}"),
        (Some(low), Some(high)) => format!(" from {low} to {high}"),
        (Some(low), None) if schema.get("exclusiveMinimum").is_some() => format!(" above {low}"),
        (Some(low), None) => format!(" from {low}"),
        _ => String::new(),
    };
    match schema["type"].as_str() {
        Some("integer") => format!("integer{range}"),
        Some("number") => format!("number{range}"),
        Some("boolean") => "`true`, `false`".to_owned(),
        Some("string") => "text".to_owned(),
        Some("array") => format!("list of {}", values(&schema["items"], root)),
        Some("object") => "table".to_owned(),
        other => panic!("no words for {other:?} in {schema}"),
    }
}

fn default(schema: &Value) -> String {
    match schema.get("default") {
        None | Some(Value::Object(_)) => String::new(),
        Some(value) => format!("`{value}`"),
    }
}

/// What a key means, and what its words mean.
fn meaning(schema: &Value, root: &Value) -> String {
    let mut text = sentence(&schema["description"]);
    let target = resolved(schema, root);
    for choice in target["oneOf"].as_array().into_iter().flatten() {
        if let (Some(word), Some(_)) = (choice.get("const"), choice.get("description")) {
            text += &format!(" `{word}`: {}", sentence(&choice["description"]));
        }
    }
    let examples = schema["examples"].as_array().into_iter().flatten();
    let examples: Vec<String> = examples.map(|example| format!("`{example}`")).collect();
    if !examples.is_empty() {
        text += &format!(" For example {}.", examples.join(", "));
    }
    text.trim().to_owned()
}
