//! Answers that were just computed, kept as long as what they are made of is the newest: who asks for the same again is not
//! computed anew. Bounded in number and bytes.

use super::conditional::Tag;
use axum::body::Bytes;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Answers kept, and bytes of them.
const MAX_KEPT: usize = 64;
const MAX_BYTES: usize = 16 << 20;

/// Askers of different answers wait for each other only if they share one of so many gates.
const GATES: usize = 16;

/// What was asked, and of which state of the data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Key {
    /// Path and query.
    pub(super) asked: String,
    /// Samples received of the channel.
    pub(super) received: u64,
}

/// An answer and its tag; cheap to clone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Answer {
    pub(super) body: Bytes,
    pub(super) tag: Tag,
}

/// The answers; cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct Recent {
    kept: Arc<Mutex<VecDeque<(Key, Answer)>>>,
    gates: Arc<[tokio::sync::Mutex<()>; GATES]>,
}

impl Default for Recent {
    fn default() -> Self {
        Self {
            kept: Arc::default(),
            gates: Arc::new(std::array::from_fn(|_| tokio::sync::Mutex::new(()))),
        }
    }
}

impl Recent {
    /// The answer that is kept, or that `compute` gives; who asks meanwhile waits for it.
    pub(super) async fn answer<E>(
        &self,
        key: Key,
        compute: impl Future<Output = Result<Bytes, E>>,
    ) -> Result<Answer, E> {
        if let Some(found) = self.find(&key) {
            return Ok(found);
        }
        let gate =
            key.asked.bytes().fold(0_usize, |sum, byte| sum.wrapping_mul(31) ^ usize::from(byte));
        let _turn = match self.gates.get(gate % GATES) {
            Some(gate) => Some(gate.lock().await),
            None => None,
        };
        if let Some(found) = self.find(&key) {
            return Ok(found);
        }
        let body = compute.await?;
        let made = Answer { tag: Tag::of(&body), body };
        self.keep(key, made.clone());
        Ok(made)
    }

    fn find(&self, key: &Key) -> Option<Answer> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|(one, _)| one == key).map(|(_, answer)| answer.clone())
    }

    /// Keeps an answer instead of an older one to the same question; the oldest give way.
    fn keep(&self, key: Key, answer: Answer) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(one, _)| one.asked != key.asked);
        kept.push_back((key, answer));
        let mut bytes: usize = kept.iter().map(|(_, answer)| answer.body.len()).sum();
        while kept.len() > MAX_KEPT || bytes > MAX_BYTES {
            let gone = kept.pop_front();
            bytes -= gone.map_or(bytes, |(_, answer)| answer.body.len());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn key(asked: &str, received: u64) -> Key {
        Key { asked: asked.to_owned(), received }
    }

    #[tokio::test]
    async fn what_is_asked_again_is_computed_once_until_more_has_come() {
        let (recent, n) = (Recent::default(), AtomicUsize::new(0));
        let (recent, n) = (&recent, &n);
        let ask = |asked: &'static str, received: u64| {
            let compute = async move {
                n.fetch_add(1, Ordering::Relaxed);
                tokio::task::yield_now().await;
                Ok::<_, Infallible>(Bytes::from(format!("{asked} {received}")))
            };
            async move {
                let answer = recent.answer(key(asked, received), compute).await;
                answer.map(|answer| answer.body)
            }
        };
        let (a, b, c) = tokio::join!(ask("x", 1), ask("x", 1), ask("y", 1));
        assert_eq!(
            (a.unwrap(), b.unwrap(), c.unwrap()),
            ("x 1".into(), "x 1".into(), "y 1".into())
        );
        assert_eq!(n.load(Ordering::Relaxed), 2, "those who ask together are answered by one");
        assert_eq!(ask("x", 2).await.unwrap(), "x 2");
        assert_eq!((ask("x", 2).await.unwrap(), n.load(Ordering::Relaxed)), ("x 2".into(), 3));
        assert_eq!(recent.kept.lock().unwrap().len(), 2, "one a question");
    }

    #[tokio::test]
    async fn what_is_kept_is_bounded_and_failures_are_not_kept() {
        let recent = Recent::default();
        let large = Bytes::from(vec![0; 1 << 20]);
        for n in 0..100 {
            let answer = async { Ok::<_, Infallible>(large.clone()) };
            recent.answer(key(&n.to_string(), 0), answer).await.unwrap();
        }
        assert_eq!(recent.kept.lock().unwrap().len(), 16);
        let failed = recent.answer(key("bad", 0), async { Err("busy") }).await;
        assert_eq!((failed, recent.find(&key("bad", 0))), (Err("busy"), None));
    }
}
