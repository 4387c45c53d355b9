; A pool of threads for Taichi's parallel loops, on pthreads. parallel_for has the signature that Taichi's kernels call.
;
; The caller works as thread 0. Tasks are handed out by a counter, so a thread without a core delays nobody: when the
; caller has found no more tasks, it closes the job and waits for those threads alone that have joined it. A thread that
; waits looks %spin times before it sleeps. One caller at a time has the threads; whoever calls meanwhile works alone.
target triple = "x86_64-pc-linux-gnu"

;              mutex       start       finished    0 generation, 1 open, 2 joined, 3 left, 4 tasks, 5 next, 6 threads, 7 spin, 8 busy
%pool = type { [64 x i8], [64 x i8], [64 x i8], [16 x i32], ptr, ptr }
%begin = type { ptr, i32 }

declare i32 @pthread_mutex_lock(ptr)
declare i32 @pthread_mutex_unlock(ptr)
declare i32 @pthread_cond_wait(ptr, ptr)
declare i32 @pthread_cond_signal(ptr)
declare i32 @pthread_cond_broadcast(ptr)
declare i32 @pthread_create(ptr, ptr, ptr, ptr)
declare i32 @pthread_detach(i64)
declare void @llvm.x86.sse2.pause()
declare ptr @malloc(i64)

; Take tasks until there are no more.
define internal void @take(ptr %p, i32 %thread, i32 %tasks, ptr %context, ptr %body) {
entry:
  %next = getelementptr %pool, ptr %p, i32 0, i32 3, i32 5
  br label %loop
loop:
  %i = atomicrmw add ptr %next, i32 1 seq_cst
  %some = icmp slt i32 %i, %tasks
  br i1 %some, label %work, label %end
work:
  call void %body(ptr %context, i32 %thread, i32 %i)
  br label %loop
end:
  ret void
}

; Look until *%a equals (or, %differs, no longer equals) %value, but no more than %spin times.
define internal void @look(ptr %a, i32 %value, i1 %differs, i32 %spin) {
entry:
  br label %loop
loop:
  %k = phi i32 [ 0, %entry ], [ %k1, %again ]
  %now = load atomic i32, ptr %a seq_cst, align 4
  %equal = icmp eq i32 %now, %value
  %found = xor i1 %equal, %differs
  %late = icmp sge i32 %k, %spin
  %stop = or i1 %found, %late
  br i1 %stop, label %end, label %again
again:
  call void @llvm.x86.sse2.pause()
  %k1 = add i32 %k, 1
  br label %loop
end:
  ret void
}

define internal ptr @worker(ptr %arg) {
entry:
  %p = load ptr, ptr %arg
  %mine = getelementptr %begin, ptr %arg, i32 0, i32 1
  %thread = load i32, ptr %mine
  %start = getelementptr %pool, ptr %p, i32 0, i32 1
  %finished = getelementptr %pool, ptr %p, i32 0, i32 2
  %generation = getelementptr %pool, ptr %p, i32 0, i32 3, i32 0
  %open = getelementptr %pool, ptr %p, i32 0, i32 3, i32 1
  %joined = getelementptr %pool, ptr %p, i32 0, i32 3, i32 2
  %left = getelementptr %pool, ptr %p, i32 0, i32 3, i32 3
  %tasks = getelementptr %pool, ptr %p, i32 0, i32 3, i32 4
  %spins = getelementptr %pool, ptr %p, i32 0, i32 3, i32 7
  %spin = load i32, ptr %spins
  %contexts = getelementptr %pool, ptr %p, i32 0, i32 4
  %bodies = getelementptr %pool, ptr %p, i32 0, i32 5
  br label %wait
wait:
  %seen = phi i32 [ 0, %entry ], [ %g, %closed ], [ %g, %leave ]
  call void @look(ptr %generation, i32 %seen, i1 1, i32 %spin)
  %l = call i32 @pthread_mutex_lock(ptr %p)
  br label %asleep
asleep:
  %g = load i32, ptr %generation
  %same = icmp eq i32 %g, %seen
  br i1 %same, label %sleep, label %awake
sleep:
  %w = call i32 @pthread_cond_wait(ptr %start, ptr %p)
  br label %asleep
awake:
  %o = load i32, ptr %open
  %is = icmp eq i32 %o, 1
  br i1 %is, label %join, label %closed
closed:
  %u = call i32 @pthread_mutex_unlock(ptr %p)
  br label %wait
join:
  %j = load i32, ptr %joined
  %j1 = add i32 %j, 1
  store i32 %j1, ptr %joined
  %n = load i32, ptr %tasks
  %c = load ptr, ptr %contexts
  %b = load ptr, ptr %bodies
  %u2 = call i32 @pthread_mutex_unlock(ptr %p)
  call void @take(ptr %p, i32 %thread, i32 %n, ptr %c, ptr %b)
  %l2 = call i32 @pthread_mutex_lock(ptr %p)
  %f = load i32, ptr %left
  %f1 = add i32 %f, 1
  store atomic i32 %f1, ptr %left seq_cst, align 4
  %j2 = load i32, ptr %joined
  %last = icmp eq i32 %f1, %j2
  br i1 %last, label %signal, label %leave
signal:
  %s = call i32 @pthread_cond_signal(ptr %finished)
  br label %leave
leave:
  %u3 = call i32 @pthread_mutex_unlock(ptr %p)
  br label %wait
}

; A loop without other threads.
define void @serial_for(ptr %p, i32 %n, i32 %threads, ptr %context, ptr %body) {
entry:
  br label %loop
loop:
  %i = phi i32 [ 0, %entry ], [ %i1, %work ]
  %some = icmp slt i32 %i, %n
  br i1 %some, label %work, label %end
work:
  call void %body(ptr %context, i32 0, i32 %i)
  %i1 = add i32 %i, 1
  br label %loop
end:
  ret void
}

define void @parallel_for(ptr %p, i32 %n, i32 %threads, ptr %context, ptr %body) {
entry:
  %counts = getelementptr %pool, ptr %p, i32 0, i32 3, i32 6
  %count = load i32, ptr %counts
  %few = icmp slt i32 %count, 2
  %one = icmp slt i32 %n, 2
  %alone = or i1 %few, %one
  br i1 %alone, label %serial, label %acquire
acquire:
  %busy = getelementptr %pool, ptr %p, i32 0, i32 3, i32 8
  %exchanged = cmpxchg ptr %busy, i32 0, i32 1 seq_cst seq_cst
  %mine = extractvalue { i32, i1 } %exchanged, 1
  br i1 %mine, label %together, label %serial
serial:
  call void @serial_for(ptr %p, i32 %n, i32 %threads, ptr %context, ptr %body)
  ret void
together:
  %next = getelementptr %pool, ptr %p, i32 0, i32 3, i32 5
  %start = getelementptr %pool, ptr %p, i32 0, i32 1
  %finished = getelementptr %pool, ptr %p, i32 0, i32 2
  %generation = getelementptr %pool, ptr %p, i32 0, i32 3, i32 0
  %open = getelementptr %pool, ptr %p, i32 0, i32 3, i32 1
  %joined = getelementptr %pool, ptr %p, i32 0, i32 3, i32 2
  %left = getelementptr %pool, ptr %p, i32 0, i32 3, i32 3
  %tasks = getelementptr %pool, ptr %p, i32 0, i32 3, i32 4
  %spins = getelementptr %pool, ptr %p, i32 0, i32 3, i32 7
  %spin = load i32, ptr %spins
  %contexts = getelementptr %pool, ptr %p, i32 0, i32 4
  %bodies = getelementptr %pool, ptr %p, i32 0, i32 5
  %l = call i32 @pthread_mutex_lock(ptr %p)
  store i32 %n, ptr %tasks
  store ptr %context, ptr %contexts
  store ptr %body, ptr %bodies
  store i32 0, ptr %next
  store i32 0, ptr %joined
  store i32 0, ptr %left
  store i32 1, ptr %open
  %g = load i32, ptr %generation
  %g1 = add i32 %g, 1
  store atomic i32 %g1, ptr %generation seq_cst, align 4
  %b = call i32 @pthread_cond_broadcast(ptr %start)
  %u = call i32 @pthread_mutex_unlock(ptr %p)
  call void @take(ptr %p, i32 0, i32 %n, ptr %context, ptr %body)
  %l2 = call i32 @pthread_mutex_lock(ptr %p)
  store i32 0, ptr %open
  %j = load i32, ptr %joined
  %u2 = call i32 @pthread_mutex_unlock(ptr %p)
  call void @look(ptr %left, i32 %j, i1 0, i32 %spin)
  %l3 = call i32 @pthread_mutex_lock(ptr %p)
  br label %check
check:
  %f = load i32, ptr %left
  %all = icmp eq i32 %f, %j
  br i1 %all, label %end, label %sleep
sleep:
  %w = call i32 @pthread_cond_wait(ptr %finished, ptr %p)
  br label %check
end:
  %u3 = call i32 @pthread_mutex_unlock(ptr %p)
  store atomic i32 0, ptr %busy seq_cst, align 4
  ret void
}

; A pool of %threads threads with the caller; a zeroed mutex and condition variable are valid ones of glibc.
define void @start_pool(ptr %p, i32 %threads, i32 %spin) {
entry:
  %counts = getelementptr %pool, ptr %p, i32 0, i32 3, i32 6
  store i32 %threads, ptr %counts
  %spins = getelementptr %pool, ptr %p, i32 0, i32 3, i32 7
  store i32 %spin, ptr %spins
  %id = alloca i64
  br label %loop
loop:
  %k = phi i32 [ 1, %entry ], [ %k1, %more ]
  %some = icmp slt i32 %k, %threads
  br i1 %some, label %more, label %end
more:
  %arg = call ptr @malloc(i64 16)
  store ptr %p, ptr %arg
  %mine = getelementptr %begin, ptr %arg, i32 0, i32 1
  store i32 %k, ptr %mine
  %r = call i32 @pthread_create(ptr %id, ptr null, ptr @worker, ptr %arg)
  %t = load i64, ptr %id
  %d = call i32 @pthread_detach(i64 %t)
  %k1 = add i32 %k, 1
  br label %loop
end:
  ret void
}
