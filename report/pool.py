"""Parallel computation for pages."""

import concurrent.futures
import multiprocessing
import os

_call = None  # function and shared data of the forked processes


def _one(job):
    function, shared = _call
    return function(job, *shared)


def forked(function, jobs, *shared):
    """Calls function(job, *shared) for every job; results in order. Forked processes share `shared` without a copy."""
    global _call
    _call = function, shared
    workers = min(len(os.sched_getaffinity(0)), 4, len(jobs))
    if workers < 2:
        return [_one(job) for job in jobs]
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
        return list(pool.map(_one, jobs))
