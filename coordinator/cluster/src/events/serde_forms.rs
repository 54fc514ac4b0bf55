//! How ids, times and introductions of events are written in JSON.

/// A worker's introduction as its fields, with the credential that its principal stands for beside that.
pub mod introduction {
    use proto::Introduction;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

    #[derive(Serialize, Deserialize)]
    struct Form {
        name: String,
        threads: u32,
        build: String,
        credential: Option<String>,
        principal: String,
    }

    pub fn serialize<S: Serializer>(introduction: &Introduction, serializer: S) -> Result<S::Ok, S::Error> {
        let Introduction { name, threads, build, principal } = introduction.clone();
        let (credential, principal) = (principal.credential(), principal.to_string());
        Form { name, threads, build, credential, principal }.serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Introduction, D::Error> {
        let Form { name, threads, build, principal, .. } = Form::deserialize(deserializer)?;
        let principal = principal.parse().map_err(D::Error::custom)?;
        Ok(Introduction { name, threads, build, principal })
    }
}

/// A worker id as 32 hexadecimal digits.
pub mod worker_id {
    use proto::WorkerId;
    use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};

    pub fn serialize<S: Serializer>(id: &WorkerId, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(id)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<WorkerId, D::Error> {
        let text = String::deserialize(deserializer)?;
        WorkerId::from_hex(&text)
            .ok_or_else(|| D::Error::custom(format!("worker: must be 32 hexadecimal digits, got {text:?}")))
    }
}

/// A job id as its number.
pub mod job_id {
    use proto::JobId;
    use serde::{Deserialize as _, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(id: &JobId, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(id.0)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<JobId, D::Error> {
        u64::deserialize(deserializer).map(JobId)
    }
}

/// A time as milliseconds since 1970.
pub mod milliseconds {
    use std::time::{Duration, SystemTime};

    use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};

    pub fn serialize<S: Serializer>(at: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
        let since = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        serializer.serialize_u64(since.as_millis() as u64)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SystemTime, D::Error> {
        let since = Duration::from_millis(u64::deserialize(deserializer)?);
        let at = SystemTime::UNIX_EPOCH.checked_add(since);
        at.ok_or_else(|| D::Error::custom("at_ms: must be a time that the clock can show"))
    }
}
