//! The kind of a statement, by its tokens, and the names that it gives to tables of its own.

use super::error::QueryError;

/// Kind of a statement.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Statement {
    /// Anything that polars answers.
    Select,
    /// `SHOW TABLES`.
    ShowTables,
    /// `DESCRIBE table`.
    Describe(String),
}

/// Names, keywords, `||` and single other characters of a statement; comments and texts are left out.
#[derive(Debug)]
pub(super) struct Tokens(Vec<String>);

impl Tokens {
    pub(super) fn of(sql: &str) -> Self {
        let mut words = Vec::new();
        let mut rest = sql.trim_start();
        while let Some(first) = rest.chars().next() {
            // Up to `end`, or all of it, which the parser will refuse.
            let within = |text: &str, start: usize, end: &str| {
                text[start..].find(end).map_or(text.len(), |at| start + at + end.len())
            };
            let length = if rest.starts_with("--") {
                within(rest, 2, "\n")
            } else if rest.starts_with("/*") {
                within(rest, 2, "*/")
            } else if first == '\'' {
                within(rest, 1, "'")
            } else if first == '"' || first == '`' {
                let length = within(rest, 1, if first == '"' { "\"" } else { "`" });
                words.push(rest[..length].trim_matches(first).to_owned());
                length
            } else {
                let is_of_name = |c: char| c.is_alphanumeric() || c == '_';
                let name = rest.find(|c| !is_of_name(c)).unwrap_or(rest.len());
                let length = match name {
                    0 if rest.starts_with("||") => 2,
                    0 => first.len_utf8(),
                    name => name,
                };
                words.push(rest[..length].to_owned());
                length
            };
            rest = rest[length..].trim_start();
        }
        Self(words)
    }

    /// The kind of a statement that only reads. Everything else is refused: polars would make, empty and drop tables in
    /// memory, while the files stay as they are.
    pub(super) fn statement(&self) -> Result<Statement, QueryError> {
        let words: Vec<&str> =
            self.0.iter().map(String::as_str).skip_while(|word| *word == "(").take(3).collect();
        let is = |place: usize, keyword: &str| {
            words.get(place).is_some_and(|word| word.eq_ignore_ascii_case(keyword))
        };
        let ends = |place: usize| words.get(place).is_none_or(|word| *word == ";");
        match &words[..] {
            [_, table, ..] if (is(0, "DESCRIBE") || is(0, "DESC")) && ends(2) => {
                Ok(Statement::Describe((*table).to_owned()))
            }
            [_, _, ..] if is(0, "SHOW") && is(1, "TABLES") && ends(2) => Ok(Statement::ShowTables),
            _ if ["SELECT", "WITH", "FROM", "VALUES"].iter().any(|keyword| is(0, keyword)) => {
                Ok(Statement::Select)
            }
            [_, _, ..] if is(0, "EXPLAIN") && (is(1, "SELECT") || is(1, "WITH")) => Ok(Statement::Select),
            _ => Err(QueryError::Statement(self.0.iter().take(3).cloned().collect::<Vec<_>>().join(" "))),
        }
    }

    /// How many operators there are of the kind that polars evaluates one inside the other: `a || b || c`.
    pub(super) fn nesting(&self) -> usize {
        let nest =
            |word: &&String| ["||", "IS", "IN", "LIKE"].iter().any(|other| word.eq_ignore_ascii_case(other));
        self.0.iter().filter(nest).count()
    }

    /// Whether the name occurs.
    pub(super) fn has(&self, name: &str) -> bool {
        self.0.iter().any(|word| word == name)
    }

    /// Whether the statement defines a table of this name: `WITH name AS (…)`, perhaps with names of columns.
    pub(super) fn define(&self, name: &str) -> bool {
        (1..self.0.len()).any(|at| self.0[at] == name && self.defines(at))
    }

    fn defines(&self, at: usize) -> bool {
        let is = |word: Option<&String>, keyword: &str| {
            word.is_some_and(|word| word.eq_ignore_ascii_case(keyword))
        };
        let before = self.0.get(at - 1);
        let mut after = self.0[at + 1..].iter().peekable();
        if is(after.peek().copied(), "(") {
            after.by_ref().find(|word| *word == ")");
        }
        [",", "WITH", "RECURSIVE"].iter().any(|keyword| is(before, keyword))
            && is(after.next(), "AS")
            && is(after.find(|word| !is(Some(word), "NOT") && !is(Some(word), "MATERIALIZED")), "(")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn questions_are_told_from_everything_else_by_their_first_words() {
        let kind = |sql: &str| Tokens::of(sql).statement();
        for sql in [
            "SELECT 1",
            "  ((select 1))",
            "-- DROP TABLE run\nSELECT 1;",
            "/* DELETE */ WITH a AS (SELECT 1) SELECT * FROM a",
            "EXPLAIN SELECT * FROM run",
            "VALUES (1)",
            "FROM run",
            "SELECT 'DROP TABLE run; --'",
        ] {
            assert!(matches!(kind(sql), Ok(Statement::Select)), "{sql}");
        }
        for sql in ["SHOW TABLES", "show tables;", "-- all\nSHOW /* the */ TABLES"] {
            assert!(matches!(kind(sql), Ok(Statement::ShowTables)), "{sql}");
        }
        for sql in ["DESCRIBE run", "desc \"run\";"] {
            assert!(matches!(kind(sql), Ok(Statement::Describe(table)) if table == "run"), "{sql}");
        }
        for sql in [
            "",
            ";",
            "--",
            "DROP TABLE run",
            "/* SELECT */ DELETE FROM run",
            "'SELECT'",
            "CREATE TABLE a AS SELECT 1",
            "COPY run TO 'run.csv'",
            "EXPLAIN DELETE FROM run",
            "TABLE run",
            "SHOW COLUMNS FROM run",
            "DESCRIBE",
            "DESCRIBE run run",
            "é",
        ] {
            assert!(matches!(kind(sql), Err(QueryError::Statement(_))), "{sql}");
        }
    }

    #[test]
    fn what_nests_is_counted_outside_of_texts() {
        for (sql, expected) in
            [("a||b || c IS NOT NULL", 3), ("a IN (1) in (2)", 2), ("'a || b' -- IS", 0), ("|", 0)]
        {
            assert_eq!(Tokens::of(sql).nesting(), expected, "{sql}");
        }
    }

    #[test]
    fn tables_that_a_statement_defines_are_found() {
        for (sql, expected) in [
            ("WITH best AS (SELECT 1) SELECT * FROM best", true),
            ("with a as (select 1), \"best\" (x, y) as materialized (select 1) select 1", true),
            ("WITH RECURSIVE best AS (SELECT 1) SELECT 1", true),
            ("SELECT * FROM best", false),
            ("WITH a AS (SELECT 1) SELECT *, best AS b FROM best", false),
            ("WITH a AS (SELECT * FROM cells, best AS (x)) SELECT '/* WITH best AS (' FROM a", true),
            ("SELECT 'WITH best AS (SELECT 1)' FROM best", false),
            ("SELECT 1 -- WITH best AS (SELECT 1)", false),
        ] {
            assert_eq!(Tokens::of(sql).define("best"), expected, "{sql}");
        }
    }
}
