//! The reference of the protocol, made from the `.proto` files as they are compiled into the programs.

use std::collections::BTreeMap;

use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
};

const INTRODUCTION: &str = "# Protocol

Made from [`proto/descry/v2`](../../../proto/descry/v2/coordinator.proto); a test keeps it so. A coordinator takes workers of its own major version, and of its own minor version or a later one.
";
/// Files in the order in which they are read best.
const FILES: [(&str, &str); 3] = [
    ("descry/v2/coordinator.proto", "How workers talk to a coordinator"),
    ("descry/v2/task.proto", "What a task is"),
    ("descry/v2/journal.proto", "What the journal keeps"),
];

/// Comments by the path of what they stand before.
struct Comments(BTreeMap<Vec<i32>, String>);

impl Comments {
    fn of(file: &FileDescriptorProto) -> Self {
        let locations = file.source_code_info.iter().flat_map(|info| &info.location);
        let comments = locations.filter_map(|location| {
            let detached = location.leading_detached_comments.iter().map(String::as_str);
            let text = detached.chain(location.leading_comments.as_deref()).collect::<Vec<_>>().join("\n\n");
            (!text.is_empty()).then(|| (location.path.clone(), text))
        });
        Self(comments.collect())
    }

    /// Paragraphs.
    fn paragraphs(&self, path: &[i32]) -> String {
        let text = self.0.get(path).map_or("", String::as_str);
        let paragraphs = text.split("\n\n").flat_map(|text| text.split("\n \n"));
        let paragraphs = paragraphs.map(|text| text.lines().map(str::trim).collect::<Vec<_>>().join(" "));
        paragraphs.map(|text| text.trim().replace('<', "&lt;")).collect::<Vec<_>>().join("\n\n")
    }

    fn line(&self, path: &[i32]) -> String {
        self.paragraphs(path).replace("\n\n", " ").replace('|', "\\|")
    }
}

/// The page.
pub fn markdown(descriptor_set: &[u8]) -> String {
    let set = FileDescriptorSet::decode(descriptor_set).unwrap();
    let mut page = INTRODUCTION.to_owned();
    for (name, title) in FILES {
        let file = set.file.iter().find(|file| file.name() == name).unwrap();
        let comments = Comments::of(file);
        page += &format!("\n## {title}\n\n`{name}`\n");
        // Before `syntax`.
        let about = comments.paragraphs(&[12]);
        if !about.is_empty() {
            page += &format!("\n{about}\n");
        }
        for (s, service) in file.service.iter().enumerate() {
            page += &format!(
                "\n### service {}\n\n| call | request | reply | |\n|---|---|---|---|\n",
                service.name()
            );
            for (m, method) in service.method.iter().enumerate() {
                let stream = if method.server_streaming() { "stream of " } else { "" };
                let [request, reply] = [method.input_type(), method.output_type()].map(short);
                let text = comments.line(&[6, s as i32, 2, m as i32]);
                page += &format!("| `{}` | `{request}` | {stream}`{reply}` | {text} |\n", method.name());
            }
        }
        for (index, message) in file.message_type.iter().enumerate() {
            page += &message_section(message, &[4, index as i32], &comments);
        }
        for (index, values) in file.enum_type.iter().enumerate() {
            page += &enum_section(values, &[5, index as i32], &comments);
        }
    }
    page
}

fn short(name: &str) -> &str {
    name.strip_prefix(".descry.v2.").unwrap_or(name)
}

fn message_section(message: &DescriptorProto, path: &[i32], comments: &Comments) -> String {
    assert!(
        message.nested_type.is_empty() && message.enum_type.is_empty(),
        "{}: nested types",
        message.name()
    );
    let mut text = format!("\n### {}\n\n", message.name());
    let about = comments.paragraphs(path);
    if !about.is_empty() {
        text += &format!("{about}\n\n");
    }
    if message.field.is_empty() {
        return text + "No fields.\n";
    }
    text += "| no. | field | type | |\n|---|---|---|---|\n";
    for (index, field) in message.field.iter().enumerate() {
        let one_of = field.oneof_index.filter(|_| !field.proto3_optional());
        let one_of = one_of.map(|one| format!("one of `{}`. ", message.oneof_decl[one as usize].name()));
        let meaning = comments.line(&[path, &[2, index as i32]].concat());
        let meaning = one_of.unwrap_or_default() + &meaning;
        text +=
            &format!("| {} | `{}` | {} | {} |\n", field.number(), field.name(), kind(field), meaning.trim());
    }
    text
}

fn kind(field: &FieldDescriptorProto) -> String {
    let name = match field.r#type() {
        Type::Message | Type::Enum => short(field.type_name()).to_owned(),
        scalar => scalar.as_str_name().strip_prefix("TYPE_").unwrap().to_lowercase(),
    };
    match field.label() {
        Label::Repeated => format!("repeated `{name}`"),
        _ if field.proto3_optional() => format!("optional `{name}`"),
        _ => format!("`{name}`"),
    }
}

fn enum_section(values: &EnumDescriptorProto, path: &[i32], comments: &Comments) -> String {
    let mut text = format!("\n### {}\n\n", values.name());
    let about = comments.paragraphs(path);
    if !about.is_empty() {
        text += &format!("{about}\n\n");
    }
    text += "| no. | value | |\n|---|---|---|\n";
    for (index, value) in values.value.iter().enumerate() {
        let meaning = comments.line(&[path, &[2, index as i32]].concat());
        text += &format!("| {} | `{}` | {meaning} |\n", value.number(), value.name());
    }
    text
}
