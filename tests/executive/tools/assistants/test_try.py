import pytest
def test_x(assistant):
    print(assistant.listed())
    for t,a in [("list_files",{}),("read_file",{"path":"look.yaml"}),("check",{"path":"look.yaml"}),("show",{"tree":"look.yaml"}),("dry_run",{"tree":"look.yaml"}),("test",{"scenario":"look_scenario.yaml"}),("run",{"tree":"look.yaml"}),("runs",{}),("explain",{}),("evidence",{"runs":["last"]}),("approve",{"tree":"look.yaml","cell":"bench.yaml","reason":"x"}),("skills",{"name":"Refin"}),("words",{"name":"retry"}),("failure_codes",{"code":"NO_PATH"}),("run",{"tree":3,"q":1}),("run",{"tree":{}})]:
        try:
            print("==",t,assistant.call(t,**a)[:1500])
        except Exception as e: print("!!",t,type(e),e)
    print(assistant.listed())
    for u in assistant.listed()[1]+["file:///etc/passwd","pomona://runs/..%2F../summary"]:
        try: print(assistant.read(u)[:500])
        except Exception as e: print("!!",type(e),e)
    print((assistant.folder/"runs/assistants.jsonl").read_text())
    print(list((assistant.folder/"runs").rglob("*")))
