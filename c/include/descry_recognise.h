/*
 * libdescry_recognise: names objects in coloured point clouds.
 *
 * An artefact is the folder that `coordinator export` of Descry makes: a descriptor, and reference
 * clouds described by it. A program opens it once and asks it about clouds, which it has as arrays.
 * Answers are those of `coordinator recognise`, bit for bit.
 *
 *     descry_recogniser *recogniser;
 *     descry_answer *answer;
 *     if (descry_recogniser_open("objects", &recogniser) != DESCRY_OK) {
 *         fprintf(stderr, "%s\n%s\n", descry_error_what(), descry_error_advice());
 *         return 1;
 *     }
 *     if (descry_recogniser_recognise(recogniser, xyz, rgb, points, NULL, 1, &answer) == DESCRY_OK) {
 *         printf("%s\n", answer->ranking[0].instance);
 *         descry_answer_free(answer);
 *     }
 *     descry_recogniser_free(recogniser);
 *
 * Clouds. `xyz` holds `points` times x, y, z, one behind the other; `rgb` as many times red, green,
 * blue, 0 to 255, or is NULL for a cloud without colours, which descriptors of colour refuse.
 * Lengths are in the artefact's unit: metres, unless `unit = "mm"` stands in its descriptor.toml.
 * Points with a coordinate that is not finite are left out. `viewpoint` is where the camera is, x, y,
 * z; NULL stands for 0, 0, 0, which it is in the camera's own frame. It orients the normals. A cloud
 * has at most 22369621 points. Arrays are only read, and not after the call.
 *
 * Errors. Functions that can fail return DESCRY_OK or what went wrong, as a number;
 * descry_error_what() and descry_error_advice() say it in words. Both are of the calling thread:
 * calls on other threads do not change them. NULL and misaligned pointers are refused where they
 * are not allowed; other pointers that do not point to what they should cannot be told.
 *
 * Ownership. What a function stores in its last argument belongs to the caller, who frees it with
 * the function of its name, once: descry_recogniser_free, descry_answer_free. Both take NULL. An
 * answer does not need its recogniser any more. Texts that functions return belong to the library.
 * Texts are UTF-8.
 *
 * Threads. A recogniser does not change: any number of threads may use one at once. It must not be
 * freed while a call uses it. Calls work on the thread that makes them, with a stack of 256 KiB or
 * more. Opening an artefact that learns from its reference clouds (recogniser projection or
 * kernel-ridge) starts one thread a core, or as many as the environment variable RAYON_NUM_THREADS
 * says, which then stay, asleep: open such an artefact after the last fork().
 *
 * The process. The library prints nothing, unless it has a defect, which it reports on standard
 * error and by DESCRY_ERROR_INTERNAL. It installs no signal handler and reads only the artefact's
 * files and the environment. If memory runs out, the process is aborted. Every bit is the same only
 * with the usual floating-point environment: rounding to nearest, denormal numbers kept, which
 * programs linked with -ffast-math change for the whole process.
 */


#ifndef DESCRY_RECOGNISE_H
#define DESCRY_RECOGNISE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Made from the sources by cbindgen; see c/tests/header.rs. */

/**
 * What a call has come to.
 */
typedef enum descry_status {
  /**
   * All is well.
   */
  DESCRY_OK = 0,
  /**
   * An argument that nothing can be done with: NULL, misaligned, too large; or such an environment variable.
   */
  DESCRY_ERROR_ARGUMENT = 1,
  /**
   * The array is too small. How many elements it needs has been stored, and nothing else.
   */
  DESCRY_ERROR_BUFFER = 2,
  /**
   * A file of the artefact cannot be read.
   */
  DESCRY_ERROR_READ = 3,
  /**
   * The artefact is damaged, was changed by hand, or is something else.
   */
  DESCRY_ERROR_ARTEFACT = 4,
  /**
   * The artefact is of a release that computes other numbers.
   */
  DESCRY_ERROR_VERSION = 5,
  /**
   * The cloud cannot be described, for example because it shows too little of the object.
   */
  DESCRY_ERROR_CLOUD = 6,
  /**
   * A defect of the library. The recogniser can be freed, but should no longer be asked.
   */
  DESCRY_ERROR_INTERNAL = 7,
} descry_status;

/**
 * An artefact at work.
 */
typedef struct descry_recogniser descry_recogniser;

/**
 * How many values one channel of a signature has.
 */
typedef struct descry_channel {
  /**
   * Values of the centroid: the mean over keypoints.
   */
  size_t centroid;
  /**
   * Values of the standard deviation over keypoints: as many, or 0 in a channel of the whole cloud.
   */
  size_t deviation;
} descry_channel;

/**
 * An object by the reference cloud that is nearest, or most like the cloud that was asked about.
 */
typedef struct descry_named {
  /**
   * The object.
   */
  const char *instance;
  /**
   * The object's category.
   */
  const char *category;
  /**
   * The reference cloud: its path below the folder of data that the artefact was made of.
   */
  const char *cloud;
  /**
   * Set distance to the reference cloud; of a recogniser that learns, 1 less the object's score.
   */
  double distance;
} descry_named;

/**
 * What a cloud was recognised as. Only the library makes answers; later versions may add members at the end.
 */
typedef struct descry_answer {
  /**
   * The nearest objects, nearest first.
   */
  const struct descry_named *ranking;
  /**
   * How many there are: at least 1, and no more than were asked for or the artefact knows.
   */
  size_t count;
  /**
   * Whether the object is none that the artefact knows. `ranking` then says what it is most like.
   */
  bool unknown;
  /**
   * How probably the artefact knows the object, 0 to 1, if it knows half of what it is asked; -1 if
   * the artefact has no rule for unknown objects, so that every answer is believed.
   */
  double known_probability;
} descry_answer;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The library's version, for example "0.3.0".
 */
const char *descry_version(void);

/**
 * The name of a status, for example "DESCRY_ERROR_READ"; of any other number "unknown status".
 */
const char *descry_status_name(int status);

/**
 * What went wrong in the last call of this thread that failed, in one line, "where: what, got value";
 * "" if none did. Valid until the next call of this thread that fails.
 */
const char *descry_error_what(void);

/**
 * What to do about it, as descry_error_what().
 */
const char *descry_error_advice(void);

/**
 * Opens the artefact in the folder `path`: reads and checks its files, which are not needed afterwards.
 * On failure, `*recogniser` is NULL.
 *
 * Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT, _READ, _ARTEFACT or _VERSION.
 */
enum descry_status descry_recogniser_open(const char *path,
                                          struct descry_recogniser **recogniser);

/**
 * Frees a recogniser that no call uses any more. NULL is ignored.
 */
void descry_recogniser_free(struct descry_recogniser *recogniser);

/**
 * How the values of a signature are divided: the channels in their order, each the values of its centroid
 * and then those of its deviation. `channels` has room for `capacity` elements; `*needed` becomes how many
 * there are, at most 8. `channels` may be NULL if `capacity` is 0, `needed` may be NULL.
 *
 * Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT or _BUFFER.
 */
enum descry_status descry_recogniser_channels(const struct descry_recogniser *recogniser,
                                              struct descry_channel *channels,
                                              size_t capacity,
                                              size_t *needed);

/**
 * Describes a cloud: stores its signature in `values`, which has room for `capacity` numbers. `*needed`
 * becomes how many a signature has, the same for every cloud; it is known at once, so that a call without
 * room describes nothing. `values` may be NULL if `capacity` is 0, `needed` may be NULL.
 *
 * Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT, _BUFFER or _CLOUD.
 */
enum descry_status descry_recogniser_describe(const struct descry_recogniser *recogniser,
                                              const float *xyz,
                                              const uint8_t *rgb,
                                              size_t points,
                                              const float *viewpoint,
                                              float *values,
                                              size_t capacity,
                                              size_t *needed);

/**
 * Names the object in a cloud: the `most` nearest objects, at least 1. The answer is to be freed by
 * descry_answer_free; on failure, `*answer` is NULL. That an object is unknown is an answer.
 *
 * Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT or _CLOUD.
 */
enum descry_status descry_recogniser_recognise(const struct descry_recogniser *recogniser,
                                               const float *xyz,
                                               const uint8_t *rgb,
                                               size_t points,
                                               const float *viewpoint,
                                               size_t most,
                                               struct descry_answer **answer);

/**
 * Frees an answer. NULL is ignored.
 */
void descry_answer_free(struct descry_answer *answer);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* DESCRY_RECOGNISE_H */
