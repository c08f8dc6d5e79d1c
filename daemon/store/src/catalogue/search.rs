//! Search of the catalogue, page by page.

use super::{Catalogue, SessionRow, State};
use nacre_base::Error;
use nacre_capture::plan::PlanKind;
use nacre_capture::plan::word;
use serde::{Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// Most sessions in one page.
const MAX_LIMIT: u32 = 1000;

/// Words are compared literally, so they need no escaping. All values are bound.
const SEARCH: &str = "
    SELECT * FROM session
    WHERE NOT EXISTS (SELECT 1 FROM json_each(?1) WHERE instr(words, value) = 0)
      AND (?2 IS NULL OR kind = ?2)
      AND (?3 IS NULL OR state = ?3)
      AND (?4 IS NULL OR (created, id) < (?4, ?5))
    ORDER BY created DESC, id DESC
    LIMIT ?6";

/// Search criteria and page.
#[derive(Clone, Debug, Default)]
pub struct Query {
    /// Words that must all occur in name, sample, operator, notes or folder; case is ignored.
    pub text: String,
    /// Filter by kind of plan.
    pub kind: Option<PlanKind>,
    /// Filter by state.
    pub state: Option<State>,
    /// Most sessions in the page, 1 to 1000.
    pub limit: u32,
    /// End of the previous page.
    pub after: Option<Cursor>,
}

/// One page of sessions, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Page {
    /// The sessions.
    pub sessions: Vec<SessionRow>,
    /// Start of the next page; none after the last.
    pub next: Option<Cursor>,
}

/// Position in the order of sessions, written `created.id`. It stays valid when sessions are added or removed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cursor {
    created: i64,
    id: String,
}

impl fmt::Display for Cursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.created, self.id)
    }
}

impl FromStr for Cursor {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.split_once('.').and_then(|(created, id)| Some((created.parse().ok()?, id.to_owned())));
        let (created, id) = parts.ok_or("give the `next` of the page before")?;
        Ok(Self { created, id })
    }
}

impl Serialize for Cursor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl Catalogue {
    /// Finds sessions, newest first.
    ///
    /// # Errors
    /// `Input` when the catalogue is damaged, `Output` when it cannot be used.
    pub async fn search(&self, query: &Query) -> Result<Page, Error> {
        self.try_search(query).await.map_err(|e| self.fault(e))
    }

    async fn try_search(&self, query: &Query) -> sqlx::Result<Page> {
        let lower = query.text.to_lowercase();
        let words: Vec<&str> = lower.split_whitespace().collect();
        let limit = query.limit.clamp(1, MAX_LIMIT) as usize;
        let rows = sqlx::query(SEARCH)
            .bind(serde_json::json!(words).to_string())
            .bind(query.kind.map(word))
            .bind(query.state.map(word))
            .bind(query.after.as_ref().map(|c| c.created))
            .bind(query.after.as_ref().map(|c| &c.id))
            // One more row shows whether there is another page.
            .bind(limit as i64 + 1)
            .fetch_all(&self.pool)
            .await?;
        let mut sessions = rows.iter().map(SessionRow::from_sql).collect::<sqlx::Result<Vec<_>>>()?;
        let more = sessions.len() > limit;
        sessions.truncate(limit);
        let last = sessions.last().filter(|_| more);
        let next = last.map(|row| Cursor { created: row.created, id: row.id.clone() });
        Ok(Page { sessions, next })
    }
}
