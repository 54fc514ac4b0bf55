//! The committed descriptor set against today's: nothing a released peer relies on may change or go.

use std::collections::BTreeMap;
use std::{env, fs};

use prost::Message;
use prost_types::{DescriptorProto, EnumDescriptorProto, FileDescriptorSet};

const COMMITTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/compatibility/v2.binpb");
/// Version 1 as it was released.
const RELEASED_V1: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/compatibility/v1.binpb");

/// Every promise of a descriptor set as `path -> what it is`.
fn promises(set: &FileDescriptorSet) -> BTreeMap<String, String> {
    let mut promises = BTreeMap::new();
    for file in &set.file {
        for message in &file.message_type {
            message_promises(file.package(), message, &mut promises);
        }
        for enumeration in &file.enum_type {
            enum_promises(file.package(), enumeration, &mut promises);
        }
        for service in &file.service {
            for method in &service.method {
                let path = format!("{}.{}/{}", file.package(), service.name(), method.name());
                let shape = format!(
                    "{} (stream {}) -> {} (stream {})",
                    method.input_type(),
                    method.client_streaming(),
                    method.output_type(),
                    method.server_streaming()
                );
                promises.insert(path, shape);
            }
        }
    }
    promises
}

fn message_promises(scope: &str, message: &DescriptorProto, promises: &mut BTreeMap<String, String>) {
    let scope = format!("{scope}.{}", message.name());
    promises.insert(scope.clone(), "message".to_owned());
    for field in &message.field {
        // The oneof matters on the wire: two fields of one oneof exclude each other.
        let oneof = field.oneof_index.map(|index| message.oneof_decl[index as usize].name().to_owned());
        promises.insert(
            format!("{scope}#{}", field.number()),
            format!(
                "{} {:?} {:?} {} {oneof:?}",
                field.name(),
                field.label(),
                field.r#type(),
                field.type_name()
            ),
        );
    }
    for nested in &message.nested_type {
        message_promises(&scope, nested, promises);
    }
    for enumeration in &message.enum_type {
        enum_promises(&scope, enumeration, promises);
    }
}

fn enum_promises(scope: &str, enumeration: &EnumDescriptorProto, promises: &mut BTreeMap<String, String>) {
    for value in &enumeration.value {
        promises
            .insert(format!("{scope}.{}={}", enumeration.name(), value.number()), value.name().to_owned());
    }
}

fn broken(old: &FileDescriptorSet, new: &FileDescriptorSet) -> Vec<String> {
    let new = promises(new);
    promises(old)
        .into_iter()
        .filter(|(path, was)| new.get(path) != Some(was))
        .map(|(path, was)| format!("{path}: was `{was}`, is `{}`", new.get(&path).map_or("gone", |is| is)))
        .collect()
}

fn today() -> FileDescriptorSet {
    FileDescriptorSet::decode(crate::FILE_DESCRIPTOR_SET).unwrap()
}

#[test]
fn todays_protocol_keeps_every_promise_of_the_committed_one() {
    if env::var_os("UPDATE_EXPECT").is_some() {
        fs::write(COMMITTED, crate::FILE_DESCRIPTOR_SET).unwrap();
    }
    let committed = FileDescriptorSet::decode(&*fs::read(COMMITTED).unwrap()).unwrap();
    let broken = broken(&committed, &today());
    assert!(broken.is_empty(), "breaking changes:\n{}\nadd new fields instead", broken.join("\n"));
    assert_eq!(
        promises(&committed),
        promises(&today()),
        "the protocol has grown: commit it with UPDATE_EXPECT=1 cargo test --release -p proto"
    );
}

/// A worker of version 1 has to understand its refusal.
#[test]
fn what_is_left_of_version_1_is_as_it_was_released() {
    let released = promises(&FileDescriptorSet::decode(&*fs::read(RELEASED_V1).unwrap()).unwrap());
    let mut left = today();
    left.file.retain(|file| file.package() == "descry.v1");
    let left = promises(&left);
    assert!(left.contains_key("descry.v1.Refused#2"));
    for (path, is) in left {
        assert_eq!(released.get(&path), Some(&is), "{path}");
    }
}

#[test]
fn a_renumbered_removed_or_retyped_field_is_a_breaking_change() {
    let changes: [fn(&mut DescriptorProto); 4] = [
        |message| message.field[0].number = Some(99),
        |message| drop(message.field.remove(0)),
        |message| message.field[0].r#type = Some(prost_types::field_descriptor_proto::Type::Fixed64 as i32),
        |message| message.field[0].name = Some("renamed".to_owned()),
    ];
    for change in changes {
        let mut changed = today();
        let mut messages = changed.file.iter_mut().flat_map(|file| &mut file.message_type);
        change(messages.find(|message| message.name() == "PollRequest").unwrap());
        assert_eq!(broken(&today(), &changed).len(), 1);
    }
}

#[test]
fn enums_start_at_unspecified() {
    for file in today().file {
        for enumeration in file.enum_type {
            assert_eq!(enumeration.value[0].number(), 0);
            assert!(enumeration.value[0].name().ends_with("_UNSPECIFIED"), "{}", enumeration.name());
        }
    }
}
