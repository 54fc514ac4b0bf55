//! The compiled half of the Python package: arrays in, answers out, with the interpreter's lock released in between.
//!
//! Arrays arrive contiguous and of one type each: `descry/arrays.py` sees to it. Everything that can go wrong becomes
//! `descry.Error`.

mod error;
mod pool;

use std::path::PathBuf;

use artefact::{Answer, CloudError, Seconds};
use descriptor::spacing::check_unit;
use descriptor::{Cloud, Describer, Descriptor, Preprocess, Signature, cloud_file};
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use error::raised;
use pool::pool;

/// Points, colours and the position of the camera.
type Arrays<'py> = (PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray2<'py, u8>>, [f32; 3]);

/// The same of a cloud that was read.
type ReadCloud<'py> = (Bound<'py, PyArray2<f32>>, Option<Bound<'py, PyArray2<u8>>>, (f32, f32, f32));

/// A named object, as Python sees it: instance, category, reference cloud, distance.
type Ranked = (String, String, String, f64);

/// An answer, as Python sees it: the ranking, whether the object is unknown, and how probably it is known.
type Answered = (Vec<Ranked>, bool, Option<f64>);

/// The values of a signature, and how many of them each channel has: of its centroid, and of its deviation.
type Described<'py> = (Bound<'py, PyArray1<f32>>, Vec<(usize, usize)>);

/// An answer, or the error in its place.
type AnsweredOrNot = (Option<Answered>, Option<Py<PyAny>>);

fn cloud_of((xyz, rgb, viewpoint): &Arrays<'_>) -> PyResult<Cloud> {
    let contiguous = |_| raised("xyz, rgb: must be contiguous, got strides\nuse numpy.ascontiguousarray");
    let xyz = xyz.as_slice().map_err(contiguous)?;
    let rgb = rgb.as_ref().map(PyReadonlyArray2::as_slice).transpose().map_err(contiguous)?;
    artefact::cloud_of(xyz, rgb, *viewpoint).map_err(raised)
}

/// Centroid and deviation of each channel, one behind the other.
fn joined(signatures: &[Signature]) -> Vec<f32> {
    let parts = signatures.iter().flat_map(|one| [&one.centroid, &one.deviation]);
    parts.flatten().copied().collect()
}

/// How many values each channel has: of the centroid, and of the deviation.
fn lengths(signatures: &[Signature]) -> Vec<(usize, usize)> {
    signatures.iter().map(|one| (one.centroid.len(), one.deviation.len())).collect()
}

/// What describes clouds: an artefact's descriptor, or a structure.
#[pyclass(frozen, module = "descry.native")]
struct NativeDescriber {
    form: Form,
}

enum Form {
    Artefact(Box<artefact::Recogniser>),
    Structure { describer: Describer, descriptor: Descriptor },
}

impl Form {
    /// `Err` says why there is nothing, and what to do.
    fn describe(&self, cloud: &Cloud) -> Result<Vec<Signature>, String> {
        let seconds = &mut Seconds::default();
        let described = match self {
            Self::Artefact(recogniser) => {
                recogniser.describe_cloud(cloud, seconds).map_err(|error| error.to_string())?
            }
            Self::Structure { describer, descriptor } => {
                let preprocess = Preprocess {
                    // Of a shape without colours nothing else is asked.
                    colour: cloud.colours.is_some() || descriptor.needs_colour(),
                    ..Preprocess::default()
                };
                check_unit(cloud, &preprocess).map_err(|wrong| format!("{wrong}\ngive lengths in metres"))?;
                artefact::stages(cloud, &preprocess, describer, seconds).map_err(|error| {
                    format!("{error}\nshow more of the object, and give lengths in metres")
                })?
            }
        };
        Ok(described.signatures)
    }
}

#[pymethods]
impl NativeDescriber {
    /// That of an artefact.
    #[staticmethod]
    fn artefact(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let pool = pool(py)?;
        let opened = py.detach(|| pool.install(|| artefact::Recogniser::open(&folder)));
        Ok(Self { form: Form::Artefact(Box::new(opened.map_err(raised)?)) })
    }

    /// The text of a structure file; `name` names it in errors.
    #[staticmethod]
    fn structure(text: &str, name: PathBuf) -> PyResult<Self> {
        let structure = artefact::parse_structure(text, &name).map_err(raised)?;
        let descriptor = Descriptor::Structure(structure);
        let describer = Describer::new(&descriptor).map_err(raised)?;
        Ok(Self { form: Form::Structure { describer, descriptor } })
    }

    /// The signature of a cloud as one array, and the lengths of its parts.
    fn describe<'py>(&self, py: Python<'py>, arrays: Arrays<'py>) -> PyResult<Described<'py>> {
        let cloud = cloud_of(&arrays)?;
        let signatures = py.detach(|| self.form.describe(&cloud)).map_err(raised)?;
        Ok((joined(&signatures).into_pyarray(py), lengths(&signatures)))
    }

    /// The signatures of several clouds, in parallel.
    fn describe_many<'py>(
        &self,
        py: Python<'py>,
        arrays: Vec<Arrays<'py>>,
    ) -> PyResult<Vec<Bound<'py, PyArray1<f32>>>> {
        let clouds = arrays.iter().map(cloud_of).collect::<PyResult<Vec<Cloud>>>()?;
        drop(arrays);
        let pool = pool(py)?;
        let describe = |cloud: &Cloud| Ok(joined(&self.form.describe(cloud)?));
        let described: Vec<Result<Vec<f32>, String>> =
            py.detach(|| pool.install(|| clouds.par_iter().map(describe).collect()));
        let place = |(index, one): (usize, Result<Vec<f32>, String>)| {
            one.map_err(|error| raised(format!("cloud {index}: {error}")))
        };
        let values = described.into_iter().enumerate().map(place);
        values.map(|values| Ok(values?.into_pyarray(py))).collect()
    }
}

/// An artefact at work.
#[pyclass(frozen, module = "descry.native")]
struct NativeRecogniser {
    recogniser: artefact::Recogniser,
}

impl NativeRecogniser {
    fn answer(&self, cloud: &Cloud, most: usize) -> Result<Answered, CloudError> {
        let described = self.recogniser.describe_cloud(cloud, &mut Seconds::default())?;
        Ok(owned(&self.recogniser.answer(&described, most)))
    }
}

fn owned(answer: &Answer<'_>) -> Answered {
    let ranked = |named: &artefact::Named<'_>| {
        let texts = [named.instance, named.category, named.cloud].map(str::to_owned);
        let [instance, category, cloud] = texts;
        (instance, category, cloud, named.distance)
    };
    let known = answer.known.map(|known| known.probability);
    (answer.ranking.iter().map(ranked).collect(), answer.is_unknown(), known)
}

#[pymethods]
impl NativeRecogniser {
    #[new]
    fn open(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let pool = pool(py)?;
        let opened = py.detach(|| pool.install(|| artefact::Recogniser::open(&folder)));
        Ok(Self { recogniser: opened.map_err(raised)? })
    }

    /// The nearest `most` objects.
    fn recognise(&self, py: Python<'_>, arrays: Arrays<'_>, most: usize) -> PyResult<Answered> {
        let cloud = cloud_of(&arrays)?;
        py.detach(|| self.answer(&cloud, most)).map_err(raised)
    }

    /// The answers to several clouds, in parallel: each an answer, or an error.
    fn recognise_many(
        &self,
        py: Python<'_>,
        arrays: Vec<Arrays<'_>>,
        most: usize,
    ) -> PyResult<Vec<AnsweredOrNot>> {
        let clouds = arrays.iter().map(cloud_of).collect::<PyResult<Vec<Cloud>>>()?;
        drop(arrays);
        let pool = pool(py)?;
        let answer = |cloud: &Cloud| self.answer(cloud, most);
        let answers: Vec<Result<Answered, CloudError>> =
            py.detach(|| pool.install(|| clouds.par_iter().map(answer).collect()));
        let given = |(index, answer): (usize, Result<Answered, CloudError>)| match answer {
            Ok(answer) => (Some(answer), None),
            Err(error) => {
                let error = raised(format!("cloud {index}: {error}"));
                (None, Some(error.into_value(py).into_any()))
            }
        };
        Ok(answers.into_iter().enumerate().map(given).collect())
    }
}

/// One row a point.
fn rows<'py, T: numpy::Element>(py: Python<'py>, rows: Vec<[T; 3]>) -> PyResult<Bound<'py, PyArray2<T>>> {
    let count = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([count, 3])
}

/// The cloud in the bytes of a file; `name` names it in errors.
#[pyfunction]
fn read_cloud<'py>(py: Python<'py>, content: &[u8], name: PathBuf) -> PyResult<ReadCloud<'py>> {
    let cloud = py
        .detach(|| cloud_file::read(content))
        .map_err(|error| raised(format!("{}: {error}", name.display())))?;
    let colours = cloud.colours.map(|colours| rows(py, colours)).transpose()?;
    Ok((rows(py, cloud.points)?, colours, cloud.viewpoint.into()))
}

/// The module `descry.native`.
#[pymodule(gil_used = true)]
fn native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<NativeDescriber>()?;
    module.add_class::<NativeRecogniser>()?;
    module.add_function(wrap_pyfunction!(read_cloud, module)?)
}
