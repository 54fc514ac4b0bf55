/*
 * Loads, uses and unloads libdescry_recognise several times, on threads that end afterwards, as plug-ins of a host do.
 *
 *     reload LIBRARY ARTEFACT
 *
 * Not linked with the library; tests/python/c_library.py builds and runs this.
 */
#include <descry_recognise.h>

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition) check((condition), #condition)

static void check(int condition, const char *text)
{
    if (!condition) {
        fprintf(stderr, "%s\n", text);
        exit(1);
    }
}

static void *use(void *argument)
{
    char **arguments = (char **)argument;
    void *handle = dlopen(arguments[0], RTLD_NOW | RTLD_LOCAL);
    descry_status (*open)(const char *, descry_recogniser **);
    void (*free_recogniser)(descry_recogniser *);
    const char *(*what)(void);
    descry_recogniser *recogniser;

    CHECK(handle != NULL);
    /* As POSIX has it: ISO C converts no data pointers into function pointers. */
    *(void **)&open = dlsym(handle, "descry_recogniser_open");
    *(void **)&free_recogniser = dlsym(handle, "descry_recogniser_free");
    *(void **)&what = dlsym(handle, "descry_error_what");
    CHECK(open("nowhere", &recogniser) == DESCRY_ERROR_READ);
    CHECK(what()[0] == 'n');
    CHECK(open(arguments[1], &recogniser) == DESCRY_OK);
    free_recogniser(recogniser);
    CHECK(dlclose(handle) == 0);
    return NULL;
}

int main(int argc, char **argv)
{
    pthread_t thread;
    int i;
    CHECK(argc == 3);
    for (i = 0; i < 3; i++)
        CHECK(pthread_create(&thread, NULL, use, argv + 1) == 0 && pthread_join(thread, NULL) == 0);
    return 0;
}
