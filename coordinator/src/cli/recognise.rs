//! `coordinator recognise`: which objects are these?

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use artefact::{Answer, CloudError, Named, Recogniser};
use clap::Args;
use proto::Message;
use serde_json::{Map, Value, json};

use crate::console::say;
use crate::dataset::{MAX_FILE_BYTES, cloud_bytes};
use crate::evaluate::Seconds;

/// Name the objects in clouds, with an artefact of coordinator export; on one thread
///
/// Example: coordinator recognise objects cloud.pcd --top 3
#[derive(Debug, Args)]
#[command(
    after_help = "Exit code: 0 if every cloud has an answer, also where that is that the object is unknown; 1 if one has none."
)]
pub struct Recognise {
    /// The folder that coordinator export has made, for example objects
    #[arg(value_name = "ARTEFACT")]
    artefact: PathBuf,
    /// Clouds: PCD or PLY files, or for images NAME_crop.png or a mask of a BOP scene, for example cloud.pcd; - is one
    /// PCD or PLY file on standard input
    #[arg(value_name = "CLOUD", required = true)]
    clouds: Vec<PathBuf>,
    /// List the nearest objects, too, for example 5
    #[arg(long, value_name = "K", default_value_t = 0)]
    top: usize,
    /// Name the most likely object in any case, also where the artefact takes it for unknown, for example to see
    /// what comes nearest
    #[arg(long)]
    accept_all: bool,
    /// Print the time of each stage, for example to find out what a smaller computer would take
    #[arg(long)]
    times: bool,
    /// Print one JSON object a cloud on standard output, for example for jq
    #[arg(long)]
    json: bool,
}

impl Recognise {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let clock = Instant::now();
        let recogniser = Recogniser::open(&self.artefact)?;
        if self.times {
            say(format_args!("artefact opened in {}", milliseconds(clock.elapsed())));
        }
        let mut code = ExitCode::SUCCESS;
        for path in &self.clouds {
            let (name, mut seconds) = (path.display().to_string(), Seconds::default());
            match self.recognise(&recogniser, path, &mut seconds) {
                Ok(answer) if self.json => {
                    super::print(&format!("{}\n", self.json(&name, &answer, &seconds)))?
                }
                Ok(answer) => super::print(&self.text(&name, &answer, &seconds))?,
                Err(error) => {
                    code = ExitCode::FAILURE;
                    let error = Message::of(&error);
                    say(format_args!("error: {name}: {error}"));
                    if self.json {
                        let reason = error.what;
                        super::print(&format!("{}\n", json!({ "cloud": name, "error": reason })))?;
                    }
                }
            }
        }
        Ok(code)
    }

    fn recognise<'a>(
        &self,
        recogniser: &'a Recogniser,
        path: &Path,
        seconds: &mut Seconds,
    ) -> Result<Answer<'a>, CloudError> {
        let clock = Instant::now();
        let bytes = match path {
            _ if path == Path::new("-") => read_stream(io::stdin().lock()),
            _ if is_pipe(path) => File::open(path).map_err(|error| error.to_string()).and_then(read_stream),
            _ => cloud_bytes(path),
        };
        let bytes = bytes.map_err(CloudError::Read)?;
        seconds.read = clock.elapsed();
        let answer = recogniser.recognise(&bytes, self.top.max(2), seconds)?;
        seconds.total = clock.elapsed();
        Ok(answer)
    }

    fn text(&self, name: &str, answer: &Answer<'_>, seconds: &Seconds) -> String {
        let Named { instance, category, distance, .. } = answer.nearest();
        let is_unknown = answer.is_unknown() && !self.accept_all;
        let mut text = match answer.known.filter(|_| is_unknown) {
            Some(known) => {
                let likely = format!("most like {instance} ({category})");
                format!("{name}: unknown, {likely}, known with probability {:.3}", known.probability)
            }
            None => format!("{name}: {instance} ({category})"),
        };
        text += &format!(", distance {distance:.6}");
        match answer.runner_up().zip(answer.margin()) {
            Some((other, margin)) => {
                text += &format!(", margin {margin:.6} to {} ({})\n", other.instance, other.category);
            }
            None => text += ", no other object to compare with\n",
        }
        for (rank, Named { instance, category, cloud, distance }) in (1..=self.top).zip(&answer.ranking) {
            text += &format!("  {rank:>3}  {distance:.6}  {instance} ({category}), by {cloud}\n");
        }
        if self.times {
            let stages = stages(seconds).map(|(stage, time)| format!("{stage} {}", milliseconds(time)));
            text += &format!("  {}\n", stages.join(", "));
        }
        text
    }

    fn json(&self, name: &str, answer: &Answer<'_>, seconds: &Seconds) -> Value {
        let (nearest, runner_up) = (answer.nearest(), answer.runner_up());
        let mut object = json!({
            "cloud": name,
            "predicted_instance": nearest.instance,
            "predicted_category": nearest.category,
            "nearest_cloud": nearest.cloud,
            "distance": nearest.distance,
            "runner_up_instance": runner_up.map(|other| other.instance),
            "runner_up_category": runner_up.map(|other| other.category),
            "runner_up_cloud": runner_up.map(|other| other.cloud),
            "runner_up_distance": runner_up.map(|other| other.distance),
            "margin": answer.margin(),
        });
        if let Some(known) = answer.known.filter(|_| !self.accept_all) {
            object["unknown"] = answer.is_unknown().into();
            object["known_probability"] = known.probability.into();
        }
        if self.top > 0 {
            let named = |Named { instance, category, cloud, distance }: &Named<'_>| json!({ "instance": instance, "category": category, "cloud": cloud, "distance": distance });
            object["top"] = answer.ranking.iter().take(self.top).map(named).collect();
        }
        if self.times {
            let stages = stages(seconds).map(|(stage, time)| (stage.to_owned(), time.as_secs_f64().into()));
            object["seconds"] = Map::from_iter(stages).into();
        }
        object
    }
}

/// Whether another program is to write the cloud, as `<(…)` of a shell says.
#[cfg(unix)]
fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe(_: &Path) -> bool {
    false
}

/// All of a stream, of bounded size.
fn read_stream(stream: impl Read) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    stream.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(format!("at most {MAX_FILE_BYTES} bytes expected, got more"));
    }
    Ok(bytes)
}

/// Stages by name.
fn stages(seconds: &Seconds) -> [(&'static str, Duration); 6] {
    [
        ("read", seconds.read),
        ("keypoints", seconds.keypoints),
        ("normals", seconds.normals),
        ("describe", seconds.describe),
        ("match", seconds.matching),
        ("total", seconds.total),
    ]
}

fn milliseconds(time: Duration) -> String {
    format!("{:.2} ms", 1e3 * time.as_secs_f64())
}
