//! Clients that ask beforehand for what another will ask for.

use std::cell::Cell;

use super::sharing::{ask, ask_nobody, labour};
use super::*;

#[tokio::test]
async fn what_was_foreseen_is_there_when_it_is_asked_for() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let mut client = cluster.client();
    client.rest();
    let mut foresight = cluster.foresight(client.id());
    let told = tokio::select! {
        told = ask(&mut foresight, &[1, 2]) => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    assert_eq!(told.unwrap(), [1, 2]);
    let [known, unknown] = [1, 3].map(|number| Task::Evaluation(sharing::evaluation_of(number)).job(0));
    assert_eq!((cluster.asker(known), cluster.asker(unknown)), (Some(client.id()), None));
    drop(foresight);
    assert_eq!(ask_nobody(&mut client, &[2, 1]).await, Some(vec![2, 1]));
    assert_eq!(answers.get(), 2);
}

#[tokio::test]
async fn what_is_given_up_is_computed_when_it_is_asked_for_after_all() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let mut client = cluster.client();
    let mut foresight = cluster.foresight(client.id());
    assert_eq!(ask_nobody(&mut foresight, &[1, 2]).await, None);
    // Nor does one of them wait for what the other has given up.
    let mut other = cluster.foresight(client.id());
    assert_eq!(ask_nobody(&mut other, &[2, 3]).await, None);
    drop(foresight);
    drop(other);
    assert!(cluster.state().scheduler.jobs.is_empty());
    let told = tokio::select! {
        told = ask(&mut client, &[1, 2, 3]) => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    assert_eq!((told.unwrap(), answers.get()), (vec![1, 2, 3], 3));
}

#[tokio::test]
async fn what_was_asked_for_meanwhile_is_not_given_up() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let mut client = cluster.client();
    let mut foresight = cluster.foresight(client.id());
    assert_eq!(ask_nobody(&mut foresight, &[1, 2]).await, None);
    let asked = async {
        let asked = ask(&mut client, &[2, 1]);
        let gone = async {
            tokio::task::yield_now().await;
            drop(foresight);
        };
        tokio::join!(asked, gone).0
    };
    let told = tokio::select! {
        biased;
        told = asked => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    assert_eq!((told.unwrap(), answers.get()), (vec![2, 1], 2));
}
