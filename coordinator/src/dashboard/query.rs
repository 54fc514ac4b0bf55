//! Parameters of an address.

use std::collections::BTreeMap;

use super::error::DashboardError;

/// The parameters after the `?` of an address.
pub struct Query(BTreeMap<String, String>);

impl Query {
    /// Of an address; of a parameter that comes twice the last counts.
    pub fn new(text: Option<&str>) -> Self {
        Self(form_urlencoded::parse(text.unwrap_or_default().as_bytes()).into_owned().collect())
    }

    /// A parameter that must be there.
    ///
    /// # Errors
    /// If it is not.
    pub fn text(&self, name: &'static str) -> Result<&str, DashboardError> {
        let missing = || DashboardError::Parameter { name, expected: "a value", got: "nothing".to_owned() };
        self.0.get(name).map(String::as_str).ok_or_else(missing)
    }

    /// A parameter that may be left out.
    pub fn text_if_any(&self, name: &'static str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// A number that may be left out.
    ///
    /// # Errors
    /// If it is something else.
    pub fn number<T: std::str::FromStr>(&self, name: &'static str) -> Result<Option<T>, DashboardError> {
        let Some(text) = self.text_if_any(name) else { return Ok(None) };
        let got: String = text.escape_debug().take(40).collect();
        let unfit = |_| DashboardError::Parameter { name, expected: "a number", got };
        text.parse().map(Some).map_err(unfit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_decoded_and_checked() {
        let query = Query::new(Some("id=a%2Fb+c&generation=7&event=-1"));
        assert_eq!(query.text("id").unwrap(), "a/b c");
        assert_eq!(query.number::<u32>("generation").unwrap(), Some(7));
        assert_eq!(query.number::<u32>("individual").unwrap(), None);
        let error = query.number::<u64>("event").unwrap_err().to_string();
        assert!(error.starts_with("event: a number expected, got -1\n"), "{error}");
        assert!(Query::new(None).text("id").is_err());
    }
}
