def test_x(finished, descents, tmp_path):
    import json, time, logging
    print(finished.summary["sampling"], finished.summary["noise"],finished.summary["wind"], {k:(v["mean"],v["sd"]) for k,v in finished.summary["parameters"].items()}, finished.summary["coverage"])
    from bayeschute.study.stages import run_study
    t=time.perf_counter(); l={}
    s=run_study(descents.study, tmp_path/"a", progress=lambda a,b,c: l.setdefault(a,time.perf_counter()-t)); print("again", time.perf_counter()-t, s["sampling"], l)
